"""Duration of the gap workflow on machines: `python -m benchmarks.gap_machines.speed`.

Eight runs of 1000 samples and eight effects, on two machines: a damped oscillator whose equations are smooth,
and a geared axis with dry friction and backlash. Prints seconds to the first answer and to the verdict, and
the time of one integrated run beside that of `scipy.integrate.solve_ivp` on the same equations.
"""

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from types import SimpleNamespace
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.gap_machines.models import geared_axis
from drivers.clock import SystemClock, seconds
from rover_hil.gap import Array, Channel, Parameter, Port, Run, RunParameter, StateModel, effects
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Values
from sim_backends.models.parameter_key import ParameterKey
from sim_backends.state_model.equations import Signal
from sim_backends.state_model.port_effect import PortEffect
from tests.nature.machines import geared_axis as axis_truth
from tests.nature.machines.machine import Machine

RUNS, SAMPLES = 8, 1000
SEED = 20261123
STEP_S = 0.02
NOISE_M = 0.002
TOLERANCE = 1e-6
"""Relative tolerance of the peer."""
OUR_POINTS = 64
"""Parameters of usual size that are integrated at once."""
PIECES, PIECE_SAMPLES = 89, 600
FIRST_S, WHOLE_S = 30.0, 120.0


@dataclass(frozen=True)
class Case:
    """A machine and its measured runs."""

    name: str
    model: StateModel
    runs: Sequence[Run]
    usual: Mapping[str, Values]
    """Effects at which the time of one integration is measured."""


@dataclass
class Watch:
    """Seconds at which the workflow announced each step, and what it integrated."""

    first_s: float | None = None
    steps: list[tuple[float, str]] = field(default_factory=list)
    integrations: int = 0
    start_ns: int = field(default_factory=lambda: SystemClock().now_ns())

    def elapsed_s(self) -> float:
        """Return the time since the start."""
        return seconds(SystemClock().now_ns() - self.start_ns)

    def advance(self, words: str) -> None:
        """Note a step."""
        self.steps.append((self.elapsed_s(), words))

    def first_answer(self, words: str) -> None:
        """Note the first answer."""
        self.first_s = self.elapsed_s()
        self.steps.append((self.first_s, words))


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure both machines; return 0 where both keep the times."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap_machines.speed", description=__doc__)
    parser.add_argument("--machines", default=",".join(CASES), help="separated by commas")
    parser.add_argument("--alone", action="store_true", help="do not compare with scipy")
    parser.add_argument("--steps", action="store_true", help="print when each step began")
    options = parser.parse_args(arguments)
    kept = [
        _measure(CASES[name](), has_steps=options.steps, is_alone=options.alone)
        for name in options.machines.split(",")
    ]
    return 0 if all(kept) else 1


def _measure(case: Case, *, has_steps: bool, is_alone: bool) -> bool:
    watch = Watch()
    simulate = StateModel.simulate_points

    def counted(model: StateModel, runs: Sequence[Run], points: Sequence[Any]) -> Any:
        watch.integrations += len(points) * len(runs)
        return simulate(model, runs, points)

    busy_s = sum(os.times()[:2])
    StateModel.simulate_points = counted  # type: ignore[assignment, method-assign]
    try:
        verdict = analyse(case.model, case.runs, advance=watch.advance, announce=watch.first_answer).verdict
    finally:
        StateModel.simulate_points = simulate  # type: ignore[method-assign]
    whole_s, busy_s = watch.elapsed_s(), sum(os.times()[:2]) - busy_s
    if has_steps:
        for at_s, words in watch.steps:
            print(f"  {at_s:6.1f} s  {words}")
    first = "none" if watch.first_s is None else f"{watch.first_s:.1f} s"
    print(
        f"{case.name}: first answer {first}, verdict {whole_s:.1f} s ({busy_s:.1f} s of processors), "
        f"{watch.integrations} integrated runs; "
        f"{verdict.verdict} {' and '.join(effect.name for effect in verdict.effects)}",
        flush=True,
    )
    if not is_alone:
        _compare(case)
    return watch.first_s is not None and watch.first_s <= FIRST_S and whole_s <= WHOLE_S


def _compare(case: Case) -> None:
    """Print the time of one integrated run, beside that of the peer."""
    model = case.model.refined(case.runs)
    for names in ((), *((name,) for name in case.usual)):
        chosen = {name: case.usual[name] for name in names}
        ours = _seconds(partial(model.predict_points, case.runs, [({}, chosen)] * OUR_POINTS))
        peer = _seconds(partial(_peers, model, case.runs, chosen))
        ours_ms, peer_ms = 1e3 * ours / (OUR_POINTS * RUNS), 1e3 * peer / RUNS
        steps = max([model.substeps, *(model.effect_substeps.get(name, 1) for name in names)])
        print(
            f"  {' and '.join(names) or 'no effect'}: {ours_ms:.2f} ms per run ({steps} steps per sample), "
            f"solve_ivp {peer_ms:.0f} ms, ratio {peer_ms / ours_ms:.0f}",
            flush=True,
        )


def _seconds(work: Callable[[], object]) -> float:
    clock = SystemClock()
    start_ns = clock.now_ns()
    work()
    return seconds(clock.now_ns() - start_ns)


def _peers(model: StateModel, runs: Sequence[Run], chosen: Mapping[str, Values]) -> list[Array]:
    return [_peer(model, run, chosen) for run in runs]


def _peer(model: StateModel, run: Run, chosen: Mapping[str, Values]) -> Array:
    """Return the states of one run by scipy, sample by sample since its inputs jump."""
    p = SimpleNamespace(
        **{one.name: one.nominal for one in model.parameters},
        **{one.name: one.nominal_in(run) for one in model.run_parameters},
        **run.conditions,
    )
    inputs = [
        SimpleNamespace(**{name: run.inputs[name][sample] for name in model.inputs})
        for sample in range(SAMPLES)
    ]
    active = _acting(model, chosen)
    begin = model.start(p, inputs[0])
    state = np.array([float(begin[name]) for name in model.states] + [0.0] * sum(size for *_, size in active))
    found = np.empty((SAMPLES, state.size))
    found[0] = state
    step_s = model.step_s or STEP_S
    for sample in range(1, SAMPLES):
        rate = partial(_rate, model=model, u=inputs[sample - 1], p=p, active=active)
        solved = solve_ivp(rate, (0.0, step_s), found[sample - 1], rtol=TOLERANCE, atol=TOLERANCE)
        found[sample] = solved.y[:, -1]
    return found


Acting = tuple[PortEffect, SimpleNamespace, int]


def _acting(model: StateModel, chosen: Mapping[str, Values]) -> list[Acting]:
    """Return effects, their parameters, and how many states each has of its own."""
    return [
        (
            one,
            SimpleNamespace(
                **{item.name: chosen[card.name].get(item.name, item.nominal) for item in card.parameters}
            ),
            one.memories if one.memory_rate is not None else 0,
        )
        for one, card in zip(model.port_effects, model.effects, strict=True)
        if card.name in chosen
    ]


def _rate(
    _: float,
    state: Array,
    *,
    model: StateModel,
    u: SimpleNamespace,
    p: SimpleNamespace,
    active: Sequence[Acting],
) -> Array:
    machine = SimpleNamespace(**vars(p), **vars(u), **dict(zip(model.states, state, strict=False)))
    rates = np.zeros(state.size)

    def port(name: str, value: Array) -> Array:
        place = len(model.states)
        for effect, numbers, size in active:
            own = state[place] if size == 1 else state[place : place + size] if size else None
            if effect.port == name:
                if effect.memory_rate is not None and own is not None:
                    rates[place : place + size] = effect.memory_rate(value, machine, numbers, own)
                if effect.change is not None:
                    value = effect.change(value, machine, numbers, own)
            place += size
        return value

    found = model.derivative(machine, u, p, port)
    rates[: len(model.states)] = [found[name] for name in model.states]
    return rates


def _axis() -> Case:
    """Return the geared axis of the battery with hidden dry friction; its truth sticks."""
    rng = np.random.default_rng(SEED)
    family = axis_truth.FAMILY
    plans = tuple(family.plan(rng, SAMPLES, index) for index in range(RUNS))
    parameters = {
        one.name: one.nominal * (1.0 + 0.5 * one.spread * rng.standard_normal()) for one in family.parameters
    }
    starts = tuple(
        {state.name: state.spread * float(rng.standard_normal()) for state in family.states} for _ in plans
    )
    still = tuple(np.zeros(SAMPLES) for _ in plans)
    machine = Machine(family, parameters, plans, (parameters,) * RUNS, starts, still)
    records = machine.record({"coulomb_nm": 0.03})
    runs = [
        Run(
            name=plan.name,
            conditions=dict(plan.conditions),
            inputs=dict(plan.inputs),
            measured={
                one.name: one.quantum
                * np.round((record[one.name] + one.sigma * rng.standard_normal(SAMPLES)) / one.quantum)
                for one in family.channels
            },
        )
        for plan, record in zip(plans, records, strict=True)
    ]
    usual = {"coulomb_friction": {"level": 0.03}, "backlash": {"play": 2.0}}
    return Case("geared axis", geared_axis.make_model(), runs, usual)


def _swing(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
    push = port("force", p.gain_n_v * u.voltage_v - p.damping_n_s_m * x.speed_m_s - p.spring_n_m * x.place_m)
    return {"place_m": x.speed_m_s, "speed_m_s": push / p.mass_kg}


def _oscillator() -> Case:
    """Return a driven oscillator with hidden quadratic drag; its truth is integrated by scipy."""
    model = StateModel(
        name="oscillator",
        states={"place_m": "m", "speed_m_s": "m/s"},
        inputs={"voltage_v": "V"},
        channels=(Channel(name="seen_m", unit="m", sigma=NOISE_M),),
        parameters=tuple(
            Parameter(
                name=name,
                unit=unit,
                nominal=value,
                prior_sd=share * value,
                lower=0.1 * value,
                upper=10 * value,
            )
            for name, unit, value, share in (
                ("mass_kg", "kg", 2.0, 0.0),
                ("gain_n_v", "N/V", 2.0, 0.05),
                ("damping_n_s_m", "N s/m", 1.0, 0.2),
                ("spring_n_m", "N/m", 30.0, 0.1),
            )
        ),
        derivative=_swing,
        start=lambda p, _: {"place_m": p.first_place_m, "speed_m_s": 0.0},
        output=lambda x, *_: {"seen_m": x.place_m},
        step_s=STEP_S,
        run_parameters=(RunParameter(name="first_place_m", unit="m", prior_sd=0.1),),
        ports=(Port(name="force", unit="N", force_sd=1.0),),
        port_effects=(
            effects.quadratic_drag("force", velocity="speed_m_s", size=0.5),
            effects.cubic_stiffness("force", position="place_m", size=10.0),
            effects.cogging("force", position="place_m", period=0.2, size=0.5),
            effects.offset("force", size=1.0, name="pull"),
            effects.supply_sag("voltage_v", size=0.01),
            effects.delay("voltage_v", size=0.02, longest=0.2, name="input_delay"),
            effects.lag("voltage_v", size=0.05, longest=0.5, name="input_lag"),
            effects.offset("seen_m", size=0.02, name="sensor_offset"),
        ),
    )
    rng = np.random.default_rng(SEED)
    runs = []
    for number in range(RUNS):
        voltage = 8.0 * np.repeat(rng.uniform(-1.0, 1.0, SAMPLES // 40 + 1), 40)[:SAMPLES]
        first_m = float(0.1 * rng.standard_normal())
        blank = Run(name=f"run{number}", conditions={}, inputs={"voltage_v": voltage}, measured={})
        started = replace(model, run_parameters=(replace(model.run_parameters[0], nominal=first_m),))
        seen = _peer(started, blank, {"quadratic_drag": {"coefficient": 0.5}})[:, 0]
        runs.append(replace(blank, measured={"seen_m": seen + NOISE_M * rng.standard_normal(SAMPLES)}))
    return Case("oscillator", model, runs, {"quadratic_drag": {"coefficient": 0.5}})


def _pieces() -> Case:
    """Return the oscillator in 89 pieces of 600 samples with three channels; each piece starts anywhere."""
    one = _oscillator()
    model = replace(
        one.model,
        channels=(
            *one.model.channels,
            Channel(name="seen_m_s", unit="m/s", sigma=0.02),
            Channel(name="seen_again_m", unit="m", sigma=2.0 * NOISE_M),
        ),
        start=lambda p, _: {"place_m": p.first_place_m, "speed_m_s": p.first_speed_m_s},
        output=lambda x, *_: {"seen_m": x.place_m, "seen_m_s": x.speed_m_s, "seen_again_m": x.place_m},
        run_parameters=(
            RunParameter(name="first_place_m", unit="m", prior_sd=0.1),
            RunParameter(name="first_speed_m_s", unit="m/s", prior_sd=0.5),
        ),
    )
    rng = np.random.default_rng(SEED)
    blanks = []
    for number in range(PIECES):
        voltage = 8.0 * np.repeat(rng.uniform(-1.0, 1.0, PIECE_SAMPLES // 40), 40)
        blanks.append(Run(name=f"piece{number}", conditions={}, inputs={"voltage_v": voltage}, measured={}))
    starts = {
        ParameterKey(name=name, run=run.name).text: float(sd * rng.standard_normal())
        for run in blanks
        for name, sd in (("first_place_m", 0.1), ("first_speed_m_s", 0.5))
    }
    truths = model.predict(blanks, starts, {"quadratic_drag": {"coefficient": 0.5}})
    sigma = {channel.name: channel.noise_sd for channel in model.channels}
    runs = [
        replace(
            run,
            measured={
                name: truth[name] + sd * rng.standard_normal(PIECE_SAMPLES) for name, sd in sigma.items()
            },
        )
        for run, truth in zip(blanks, truths, strict=True)
    ]
    return Case("pieces", model, runs, {})


CASES: Mapping[str, Callable[[], Case]] = {"oscillator": _oscillator, "axis": _axis, "pieces": _pieces}

if __name__ == "__main__":
    raise SystemExit(main())
