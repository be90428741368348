"""Measured machines: `python -m benchmarks.gap_machines.measured DATA`: a free-swinging pendulum.

DATA is the folder with `dynamics/pendulum.csv.gz` (github.com/dynamicslab/MultiArm-Pendulum, MIT).
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from rover_hil.datasets.csv_table import read_csv
from rover_hil.gap import Channel, Parameter, Port, Run, RunParameter, StateModel, effects
from rover_hil.gap.workflow import analyse

EVERY = 4
CARDS = ("coulomb_friction", "quadratic_drag", "asymmetric_friction", "offset")


def main(arguments: Sequence[str]) -> int:
    """Print the verdict on the pendulum."""
    if len(arguments) != 1:
        print(__doc__)
        return 2
    verdict = analyse(pendulum_model(CARDS), pendulum_runs(Path(arguments[0]), EVERY), advance=print).verdict
    print(*verdict.lines(), sep="\n")
    print(f"{verdict.seconds:.0f} s")
    return 0


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
