"""A small machine for tests: a heated body with a sensor, in few and short runs."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from rover_hil.gap import Array, Channel, Port, Run, RunParameter, StateModel, effects, parameter
from sim_backends.state_model.equations import Signal

RUNS = 4
SAMPLES = 60


def derivative(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
    heat = port("heat", p.gain * u.power - p.loss * x.warmth)
    return {"warmth": heat}


def start(p: SimpleNamespace, _: SimpleNamespace) -> dict[str, Array]:
    return {"warmth": p.first}


def output(x: SimpleNamespace, _: SimpleNamespace, __: SimpleNamespace, ___: Signal) -> dict[str, Array]:
    return {"reading": x.warmth}


MODEL = StateModel(
    name="body",
    states={"warmth": "K"},
    inputs={"power": "W"},
    channels=(Channel(name="reading", unit="K", sigma=0.02),),
    parameters=(
        parameter("gain", "K/s/W", 1.0, 0.05, 0.5, 2.0),
        parameter("loss", "1/s", 0.5, 0.05, 0.1, 2.0),
    ),
    derivative=derivative,
    start=start,
    output=output,
    step_s=0.1,
    run_parameters=(RunParameter(name="first", unit="K", prior_sd=0.5, channel="reading"),),
    ports=(Port(name="heat", unit="K/s", force_sd=0.1),),
    port_effects=(
        effects.quadratic_drag("heat", velocity="warmth", size=0.2),
        effects.saturation("power", limits=(0.5, 1.0)),
    ),
)


def small_runs(model: StateModel = MODEL, samples: int = SAMPLES, count: int = RUNS) -> list[Run]:
    """Return runs that the model itself made, with sensor noise."""
    rng = np.random.default_rng(4)
    runs = []
    for number in range(count):
        power = np.repeat(rng.uniform(-2.0, 2.0, samples // 10 + 1), 10)[:samples]
        inputs: dict[str, Array] = {"power": power}
        if model.step_s is None:
            inputs["t_s"] = 0.1 * np.arange(float(samples))
        measured = {channel.name: np.full(samples, 0.3) for channel in model.channels}
        runs.append(Run(name=f"run{number}", conditions={}, inputs=inputs, measured=measured))
    tables = model.predict(runs, {}, {})
    return [
        replace(
            run, measured={name: values + rng.normal(0.0, 0.02, samples) for name, values in table.items()}
        )
        for run, table in zip(runs, tables, strict=True)
    ]


def table_text(runs: Sequence[Run], *, time: str = "", step_s: float = 0.1) -> str:
    """Return runs as a table, with a column of times under a name where one is given."""
    head = ["run", *([time] if time else []), "power [W]", "reading [K]"]
    lines = [",".join(head)]
    for run in runs:
        for index, (power, reading) in enumerate(
            zip(run.inputs["power"], run.measured["reading"], strict=True)
        ):
            times = [f"{step_s * index:.6g}"] if time else []
            shown = "" if np.isnan(reading) else f"{reading:.5f}"
            lines.append(",".join([run.name, *times, f"{power:.5f}", shown]))
    return "\n".join(lines) + "\n"
