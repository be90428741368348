"""Measured machines: `python -m benchmarks.gap_machines.measured DATA`: a linear drive and a pendulum.

DATA is the folder with `dynamics/emps_*.csv.gz` and `dynamics/pendulum.csv.gz`, which `DATA/README.md`
describes.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from rover_hil.datasets.csv_table import read_csv
from rover_hil.gap import Channel, Parameter, Port, Run, RunParameter, StateModel, effects
from rover_hil.gap.verdict import Verdict
from rover_hil.gap.workflow import analyse
from tests.rover_hil.gap_machines.emps import emps_model, emps_runs

EVERY = 4
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
    without = analyse(emps_model(has_friction=False), identification).verdict
    _print("drive without friction cards", without)
    plain, whitened = coulomb_by_weighting(identification)
    print(f"Coulomb friction by least squares {plain:.1f} N; after whitening, AR(1), {whitened:.1f} N")
    _print("pendulum", analyse(pendulum_model(CARDS), pendulum_runs(data, EVERY)).verdict)
    return 0


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
