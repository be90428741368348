"""A measured linear drive (EMPS): its records in pieces, and the inverse model that a user would write."""

from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt

from drivers.errors import ConfigError
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.gap import Array, Channel, Parameter, Port, Run, StateModel, effects

RECORD_S, CUT_S, STEP_S, CORNER_HZ = 0.001, 2.0, 0.01, 20.0
TRAVEL_M = 0.25


def emps_runs(data: Path, name: str) -> list[Run]:
    """Return a record in pieces of 2 s: position and force through one zero-phase low-pass of 20 Hz."""
    table = read_csv(data / "dynamics" / f"emps_{name}.csv.gz", ConfigError)
    low_pass = butter(4, CORNER_HZ * 2.0 * RECORD_S)
    position = filtfilt(*low_pass, table.numbers("position"))
    force = filtfilt(*low_pass, table.numbers("motor_force"))
    velocity = np.gradient(position, RECORD_S)
    acceleration = np.gradient(velocity, RECORD_S)
    size, stride = round(CUT_S / RECORD_S), round(STEP_S / RECORD_S)
    runs = []
    for number in range(position.size // size):
        part = slice(number * size, (number + 1) * size, stride)
        inputs = {"velocity": velocity[part], "acceleration": acceleration[part], "position": position[part]}
        runs.append(
            Run(name=f"{name} {number}", conditions={}, inputs=inputs, measured={"force": force[part]})
        )
    return runs


def emps_model(*, has_friction: bool) -> StateModel:
    """Return the inverse model: the motor's force from the motion."""
    velocity, slow = "velocity", 0.002
    guide = (
        effects.coulomb_friction("resistance", velocity=velocity, size=10.0, slow=slow),
        effects.asymmetric_friction("resistance", velocity=velocity, size=2.0, slow=slow),
        effects.stribeck_friction("resistance", velocity=velocity, size=5.0, speed=0.01, slow=slow),
        effects.cogging("resistance", position="position", period=TRAVEL_M, size=2.0, name="along_travel"),
    )
    others = (
        effects.quadratic_drag("resistance", velocity=velocity, size=300.0),
        effects.offset("resistance", size=3.0),
        effects.cubic_stiffness("resistance", position="position", size=500.0),
        effects.gain_error("force", size=0.05),
    )

    def output(_: object, u: object, p: object, port: object) -> dict[str, Array]:
        motion = -p.mass * u.acceleration - p.viscous * u.velocity  # type: ignore[attr-defined]
        return {"force": -port("resistance", motion)}  # type: ignore[operator]

    return StateModel(
        name="emps",
        states={},
        inputs={"velocity": "m/s", "acceleration": "m/s^2", "position": "m"},
        channels=(Channel(name="force", unit="N", sigma=0.5),),
        parameters=(
            Parameter(name="mass", unit="kg", nominal=95.0, prior_sd=10.0, lower=10.0, upper=500.0),
            Parameter(name="viscous", unit="N s/m", nominal=200.0, prior_sd=100.0, lower=0.0, upper=2000.0),
        ),
        ports=(Port(name="resistance", unit="N", force_sd=3.0),),
        derivative=lambda *_: {},
        start=lambda *_: {},
        output=output,
        is_held=False,
        step_s=STEP_S,
        port_effects=(*guide, *others) if has_friction else others,
    )
