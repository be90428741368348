"""Measured machines: `python -m benchmarks.gap_machines.measured DATA`: a linear drive and a pendulum.

DATA is the folder with `dynamics/emps_*.csv.gz` and `dynamics/pendulum.csv.gz`, which `DATA/README.md`
describes.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.gap import Channel, Parameter, Port, Run, RunParameter, StateModel, effects
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.sizes import size_of
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.verdict import Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.models.parameter_key import ParameterKey
from tests.rover_hil.gap.emps import emps_model, emps_runs

EVERY = 4
SEED, DRAWS, DRIVES = 20261128, 2000, 200
FOUND = ("asymmetric_friction", "coulomb_friction")
CARDS = ("coulomb_friction", "quadratic_drag", "asymmetric_friction", "offset")


SLOW_M_S = 0.002
"""Speed below which friction fades, as in the model of the drive."""


def main(arguments: Sequence[str]) -> int:
    """Print the verdicts on the drive and on the pendulum."""
    if len(arguments) != 1:
        print(__doc__)
        return 2
    data = Path(arguments[0])
    identification = emps_runs(data, "identification")
    both = [*identification, *emps_runs(data, "pulses")]
    friction = emps_model(has_friction=True)
    _print("drive, both records, pulses locked", analyse(friction, both, confirm='run == "pulses*"').verdict)
    alone = analyse(friction, identification)
    _print("drive, identification record", alone.verdict)
    if alone.machine is None:
        raise TypeError("the drive is a machine")
    for base in friction.parameters:
        size = alone.machine.size("", base.name)
        print(f"  {base.name} {size.value:.4g} {base.unit}, {size.low:.4g} to {size.high:.4g}")
    _print_viscous(friction, identification)
    without = analyse(emps_model(has_friction=False), identification).verdict
    _print("drive without friction cards", without)
    plain, whitened = coulomb_by_weighting(identification)
    print(f"Coulomb friction by least squares {plain:.1f} N; after whitening, AR(1), {whitened:.1f} N")
    _print("pendulum", analyse(pendulum_model(CARDS), pendulum_runs(data, EVERY)).verdict)
    return 0


def _print_viscous(model: StateModel, runs: Sequence[Run]) -> None:
    """Print the viscous friction by least squares, and how often the intervals of `gap` hold it."""
    for words, powers in (("", 0), (" with a force along the travel, x and x^2", 2)):
        value, low, high = viscous_by_pieces(runs, powers)
        print(f"viscous friction by least squares{words}: {value:.1f}, {low:.1f} to {high:.1f} N s/m")
    for names in (FOUND, (*FOUND, "along_travel")):
        held, width = interval_coverage(model, runs, names)
        print(
            f"{', '.join(names)}: intervals hold the viscous friction in {held:.1%}, {width:.1f} N s/m wide"
        )


def viscous_by_pieces(runs: Sequence[Run], powers: int) -> tuple[float, float, float]:
    """Return the viscous friction by least squares, and its 95 % interval by a bootstrap of whole pieces."""
    rng = np.random.default_rng(SEED)
    columns, forces = [], []
    for run in runs:
        x, v = run.inputs["position"], run.inputs["velocity"]
        known = [run.inputs["acceleration"], v, np.tanh(v / SLOW_M_S), np.ones(v.size)]
        columns.append(np.stack([*known, *(x ** (power + 1) for power in range(powers))], axis=1))
        forces.append(run.measured["force"])
    chosen = [np.arange(len(runs)), *rng.integers(len(runs), size=(DRAWS, len(runs)))]
    found = [
        np.linalg.lstsq(
            np.concatenate([columns[one] for one in some]),
            np.concatenate([forces[one] for one in some]),
            rcond=None,
        )[0][1]
        for some in chosen
    ]
    low, high = np.quantile(found[1:], (0.025, 0.975))
    return float(found[0]), float(low), float(high)


def interval_coverage(model: StateModel, runs: Sequence[Run], names: tuple[str, ...]) -> tuple[float, float]:
    """Return how often intervals hold the viscous friction of generated drives, and their median width.

    A drive moves as the measured one. Its force is that of the fit with these effects, with the errors of
    this fit, whose sign is drawn for each piece: they are as large and as slow as the measured ones.
    """
    rng, key = np.random.default_rng(SEED), ParameterKey(name="viscous")
    found, problem = _fitted(model, runs, names)
    predicted = problem.predict(found.fit.point)
    errors, site = problem.observations.values - predicted, problem.observations.site
    sizes = []
    for _ in range(DRIVES):
        signs = rng.choice((-1.0, 1.0), size=len(runs))
        forces = predicted + signs[site] * errors
        drive = [replace(run, measured={"force": forces[site == number]}) for number, run in enumerate(runs)]
        sizes.append(size_of(_fitted(model, drive, names)[0], key))
    truth = found.fit.point[key]
    held = float(np.mean([one.low <= truth <= one.high for one in sizes]))
    return held, float(np.median([one.high - one.low for one in sizes]))


def _fitted(model: StateModel, runs: Sequence[Run], names: tuple[str, ...]) -> tuple[MachineFit, Problem]:
    problem = Problem(model, observe(model, runs))
    fits = MachineFits(problem, model.effects)
    return fits.best(names, {}, fits.base().fit.point), problem


def coulomb_by_weighting(runs: Sequence[Run]) -> tuple[float, float]:
    """Return the Coulomb friction by ordinary least squares, and with a misfit whitened as AR(1)."""
    columns = [
        np.stack(
            [
                run.inputs["acceleration"],
                run.inputs["velocity"],
                np.tanh(run.inputs["velocity"] / SLOW_M_S),
                np.ones(run.inputs["velocity"].size),
            ],
            axis=1,
        )
        for run in runs
    ]
    forces = [run.measured["force"] for run in runs]
    size = np.linalg.lstsq(np.concatenate(columns), np.concatenate(forces), rcond=None)[0]
    plain = float(size[2])
    for _ in range(20):
        errors = [force - column @ size for force, column in zip(forces, columns, strict=True)]
        pairs = np.concatenate([np.stack((one[:-1], one[1:])) for one in errors], axis=1)
        keep = float(pairs[0] @ pairs[1] / (pairs[0] @ pairs[0]))
        whitened = np.concatenate([one[1:] - keep * one[:-1] for one in columns])
        target = np.concatenate([one[1:] - keep * one[:-1] for one in forces])
        size = np.linalg.lstsq(whitened, target, rcond=None)[0]
    return plain, float(size[2])


def _print(title: str, verdict: Verdict) -> None:
    print(f"{title}, {verdict.seconds:.0f} s:", *verdict.lines(), sep="\n")


def pendulum_runs(data: Path, every: int) -> list[Run]:
    """Return the six free swings, one of `every` samples."""
    table = read_csv(data / "dynamics" / "pendulum.csv.gz", ConfigError)
    names, time, angle = np.array(table.text("run")), table.numbers("time"), table.numbers("angle")
    runs = []
    for name in dict.fromkeys(names.tolist()):
        here = np.flatnonzero(names == name)[::every]
        inputs = {"t_s": time[here] - time[here[0]]}
        runs.append(Run(name=str(name), conditions={}, inputs=inputs, measured={"angle_sensor": angle[here]}))
    return runs


def pendulum_model(cards: Sequence[str]) -> StateModel:
    """Return a pendulum with viscous damping."""
    known = {
        "coulomb_friction": effects.coulomb_friction("torque", velocity="rate", size=0.3, slow=0.05),
        "quadratic_drag": effects.quadratic_drag("torque", velocity="rate", size=0.01),
        "asymmetric_friction": effects.asymmetric_friction("torque", velocity="rate", size=0.3, slow=0.05),
        "offset": effects.offset("angle_sensor", size=0.02),
    }
    return StateModel(
        name="pendulum",
        states={"angle": "rad", "rate": "rad/s"},
        inputs={},
        channels=(Channel(name="angle_sensor", unit="rad", sigma=0.002),),
        parameters=(
            Parameter(name="gravity", unit="1/s^2", nominal=60.0, prior_sd=10.0, lower=1.0, upper=500.0),
            Parameter(name="viscous", unit="1/s", nominal=0.1, prior_sd=0.1, lower=0.0, upper=5.0),
        ),
        run_parameters=(
            RunParameter(name="first_angle", unit="rad", prior_sd=0.01, channel="angle_sensor"),
            RunParameter(name="first_rate", unit="rad/s", prior_sd=3.0),
        ),
        ports=(Port(name="torque", unit="rad/s^2", force_sd=0.3),),
        derivative=lambda x, _, p, port: {
            "angle": x.rate,
            "rate": port("torque", -p.gravity * np.sin(x.angle) - p.viscous * x.rate),
        },
        start=lambda p, _: {"angle": p.first_angle, "rate": p.first_rate},
        output=lambda x, *_: {"angle_sensor": x.angle},
        port_effects=tuple(known[name] for name in cards),
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
