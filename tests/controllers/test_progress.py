"""Rovers that do not get on, on contacts by slip ratio and by slip velocity, are stopped as promised.

The table is that of docs/explanation/safety.md, "A rover that makes no progress".
"""

from itertools import pairwise, product

import numpy as np
import pytest

from benchmarks.safety.healthy_missions import equipped
from benchmarks.safety.missions import drive, ground_camera, robotino, with_drooping_drives
from controllers.safety import Mode
from rover_hil.config import Config
from tests.nature.floors import bristle
from tests.nature.floors.trapped import DUG_IN, LIFTED, ONE_WHEEL, WALL, TrappedBristle
from tests.nature.omni_contact import Floor
from tests.nature.omni_trapped import TrappedOmni

SEED, AT_M, WITH_CURRENTS_M = 103, 0.3, 0.5
"""Free driving must have been seen for 0.3 m before its currents are known."""
CURRENTS = "currents"
GREATEST_M = {
    "fixes": 0.8,
    "encoders+fixes": 0.8,
    "camera": 0.3,
    "excitation": 1.5,
    CURRENTS: 1.5,
    "encoders": 0.3,
}
"""Travel of the wheels until the rover is stopped: half a metre and a period of the fixes; the window of the
camera and as much again until it is full; a metre and a half; a second of a wheel that does not turn."""
PROMISED = [
    *product(("fixes", "encoders+fixes", "camera"), (LIFTED, DUG_IN, WALL)),
    *product(("excitation",), (LIFTED, DUG_IN)),
    *product((CURRENTS,), (LIFTED, DUG_IN, WALL)),
    *product(GREATEST_M, (ONE_WHEEL,)),
]
OFTEN = {
    *product(("ratio",), ("fixes", "encoders+fixes", "camera", "excitation", CURRENTS), (DUG_IN,)),
    *product(("ratio",), ("encoders+fixes", CURRENTS), (LIFTED, WALL)),
    *product(("ratio",), ("fixes", "encoders"), (ONE_WHEEL,)),
    *product(("velocity",), ("fixes", "excitation"), (DUG_IN,)),
}
"""Each set of sensors, each trap and each law; the others are repeats."""


def _equipped(sensors: str) -> Config:
    """Return the rover with these sensors; with currents, but no excitation, where it has them."""
    config = robotino(SEED)
    if sensors != CURRENTS:
        return equipped(config, sensors)
    assert config.slip is not None
    assert config.mission is not None
    # Along the next side of the rectangle a wall would not hold it.
    mission = config.mission.model_copy(update={"length_m": 3.0})
    slip = config.slip.model_copy(update={"use": "surfaces"})
    return config.model_copy(update={"slip": slip, "mission": mission})


def travel_to_the_stop(law: str, sensors: str, trap: str) -> tuple[float, str]:
    """Return the travel of the wheels from the trap to the first stop, and its reason; "" for none."""
    at_m = WITH_CURRENTS_M if sensors == CURRENTS else AT_M
    floor = Floor.uniform("exponential", 0.006, (0.3, 4.0, 0.02, 0.06))

    def make_plant(start_ns: int) -> TrappedOmni | TrappedBristle:
        if law == "velocity":
            ground, rng = bristle.draw_floor(SEED), np.random.default_rng(SEED)
            return TrappedBristle(ground, rng, start_ns, trap=trap, at_m=at_m)
        return TrappedOmni(floor, start_ns, trap=trap, at_m=at_m)

    driven = drive(
        with_drooping_drives(_equipped(sensors)),
        limit_s=300.0 if sensors == CURRENTS else 60.0,
        make_plant=make_plant,
        make_camera=ground_camera(SEED) if sensors == "camera" else None,
    )
    travel_m, is_trapped = 0.0, False
    for before, after in pairwise(driven.moments):
        is_trapped = is_trapped or np.hypot(*before.truth[:2]) >= at_m - 0.005
        if is_trapped:
            a, b = before.output.odometry, after.output.odometry
            travel_m += float(np.hypot(b.x_m - a.x_m, b.y_m - a.y_m))
            if after.output.mode in (Mode.SAFE_STOP, Mode.EMERGENCY_STOP):
                return travel_m, after.output.reason
    assert is_trapped
    return travel_m, ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "sensors", "trap"),
    [
        pytest.param(law, *case, marks=() if (law, *case) in OFTEN else pytest.mark.nightly)
        for case in PROMISED
        for law in ("ratio", "velocity")
    ],
)
def test_a_rover_that_does_not_get_on_is_stopped_as_promised(law: str, sensors: str, trap: str) -> None:
    travel_m, reason = travel_to_the_stop(law, sensors, trap)
    expected = "progress unknown" if sensors in ("excitation", CURRENTS) else "rover: stuck"
    assert ("wheel 0: has not followed" if trap == ONE_WHEEL else expected) in reason
    assert travel_m <= GREATEST_M[sensors]
