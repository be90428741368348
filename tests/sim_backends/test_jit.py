"""A specialised function does what the compiled one does."""

import numpy as np

from sim_backends.jit import specialised
from sim_backends.plants.robotino.dynamics import Rover, State, advance
from sim_backends.plants.robotino.ground import Ground, rasterise
from sim_backends.plants.robotino.plant import make_rover
from sim_backends.plants.robotino.settings import RobotinoPlantSettings

STEPS = 500


def driven_state() -> State:
    """Return a rover at rest with unequal setpoints."""
    return State(
        pose=np.zeros(3),
        twist=np.zeros(3),
        angle_rad=np.zeros(3),
        speed_rad_s=np.zeros(3),
        current_a=np.zeros(3),
        voltage_v=np.zeros(3),
        set_ticks=np.array([3.0, -2.0, 1.0]),
        counted=np.zeros(3),
        supply=np.array([12.0]),
        step=np.zeros(1, dtype=np.int64),
    )


def test_the_specialised_integration_is_bit_identical() -> None:
    settings = RobotinoPlantSettings(type="robotino")
    rover: Rover = make_rover(settings, 5.6e-4)
    ground: Ground = rasterise(settings.site, settings.wheel_radius_m, np.random.default_rng(1))
    expected, found = driven_state(), driven_state()
    integrate = specialised(advance, found, rover, ground, 1)
    for steps in (1, STEPS):
        advance(expected, rover, ground, steps)
        integrate(found, rover, ground, steps)
    assert expected.step[0] == 1 + STEPS
    assert np.any(expected.pose != 0.0)
    for one, other in zip(expected, found, strict=True):
        assert one.tobytes() == other.tobytes()
