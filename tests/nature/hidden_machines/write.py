"""Write a case as its user has it, and its answer as nobody does who analyses it."""

import csv
from pathlib import Path

import numpy as np

from tests.nature.hidden_machines.draw import Case, noise_rng, order_of_runs, true_size
from tests.nature.hidden_machines.machine import Array
from tests.nature.hidden_machines.model_file import model_text
from tests.nature.hidden_machines.noise import read
from tests.nature.hidden_machines.simulate import simulate
from tests.nature.hidden_machines.verdicts import expected

MODEL, RUNS, ALLOWED, CALL = "machine.py", "runs.csv", "allowed.toml", "case.toml"


def write_case(case: Case, folder: Path, variant: int = 0) -> None:
    """Write model, runs and call of a variant of a case into an empty or new folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MODEL).write_text(model_text(case), "utf-8")
    _write_runs(case, folder / RUNS, variant)
    arguments = ["gap", f"{MODEL}:make", RUNS]
    if case.number % 3 == 0:
        _write_allowed(case, folder / ALLOWED)
        arguments += ["--allowed", ALLOWED]
    quoted = ", ".join(f'"{argument}"' for argument in arguments)
    (folder / CALL).write_text(f"arguments = [{quoted}]\n", "utf-8")


def answer(case: Case) -> dict[str, object]:
    """Return what is hidden in a case, and the verdict that a sensible person expects."""
    effects = [
        {
            "name": effect.name,
            "parameter": effect.parameter,
            "size": true_size(case, effect, strength),
            "is_listed": bool(effect.line),
        }
        for effect, strength in case.hidden
    ]
    terms = [
        {"port": term.port, "sources": list(term.sources), "forms": list(term.forms)}
        for effect, _ in case.hidden
        for term in effect.terms
    ]
    is_outside = bool(effects) and not any(effect["is_listed"] for effect in effects)
    kind = "outside" if is_outside else case.kind
    verdict, accepted, reason = expected(kind, case.runs, case.ratio, case.alike)
    return {
        "case": f"{case.kind}-{case.seed}-{case.number}",
        "class": case.kind,
        "machine": case.machine.name,
        "runs": case.runs,
        "noise_correlation": case.correlation,
        "effects": effects,
        "terms": terms,
        "ratio": case.ratio,
        "ratio_with_best_other": case.best_other,
        "alike": list(case.alike),
        "expected": verdict,
        "accepted": accepted,
        "reason": reason,
    }


def readings(case: Case, variant: int) -> dict[str, Array]:
    """Return the measured channels of a variant, of shape (runs, samples), runs in the order of the case."""
    rng = noise_rng(case, variant)
    factor = float(rng.uniform(0.9, 1.1))
    exact = simulate(case.machine, case.numbers, case.starts, case.inputs, case.hidden)
    return {
        sensor.name: read(exact[sensor.name], sensor, case.correlation, rng, factor)
        for sensor in case.machine.sensors
    }


def _write_runs(case: Case, path: Path, variant: int) -> None:
    machine, channels = case.machine, readings(case, variant)
    titles = [_title(command.name, command.unit) for command in machine.inputs]
    titles += [_title(condition.name, condition.unit) for condition in machine.conditions]
    titles += [_title(sensor.name, sensor.unit) for sensor in machine.sensors]
    digits = {sensor.name: 3 - int(np.floor(np.log10(sensor.sigma))) for sensor in machine.sensors}
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["run", "time [s]", *titles])
        for label, run in enumerate(order_of_runs(case, variant)):
            known = [f"{case.numbers[condition.name][run]:.10g}" for condition in machine.conditions]
            for k in range(machine.samples):
                commands = [f"{case.inputs[command.name][run, k]:.10g}" for command in machine.inputs]
                values = [f"{channels[name][run, k]:.{digit}f}" for name, digit in digits.items()]
                table.writerow([f"run{label}", f"{k * machine.step_s:.10g}", *commands, *known, *values])


def _title(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} [{unit}]"


def _write_allowed(case: Case, path: Path) -> None:
    blocks = [
        f"[inputs.{command.name}]\nlow = {command.low}\nhigh = {command.high}\n"
        for command in case.machine.inputs
    ]
    path.write_text("\n".join(blocks), "utf-8")
