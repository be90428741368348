"""What a camera whose lines are exposed one after the other does to measured motion.

The first line of a frame is exposed half the readout before the middle one, the last half of it after. Ground
that moves past is then sheared or stretched in proportion to its velocity, and the fit takes a part of that
for motion. Motion between two frames is measured wrongly by the change of that part.
"""

from typing import NamedTuple

import numpy as np

from controllers.ground_motion.flow import GroundFlow
from controllers.ground_motion.ground_patch import GroundPatch, project
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.tolerance import seen_at

READOUT_S = 0.01
"""For which the effect is computed; it is in proportion to it."""
RATE_RAD_S, SPEED_M_S = 0.1, 0.1
FREE_SD_RAD = (DEFAULTS.turn.free_tilt_sd_rad, DEFAULTS.turn.free_tilt_sd_rad, 0.05)
"""Deviations of roll, pitch and turn in the fit where the camera alone is to measure the turn."""


class RollingShutter(NamedTuple):
    """Effects of the readout, the time from the first line to the last.

    Attributes:
        turn_delay: By how much later turns seem to be, over the readout.
        stretch_per_m: By what share the travel ahead seems longer, over speed and readout, 1/m.
    """

    turn_delay: float
    stretch_per_m: float


def rolling_shutter(ground: GroundPatch) -> RollingShutter:
    """Return what each second of readout does on one rig; 0 for a global shutter is 0 of it."""
    flow = GroundFlow(ground, DEFAULTS.flow)
    points = ground.to_vehicle(*flow.points_m().T)
    late = _line_times(ground, points)[:, None]
    turned = late * RATE_RAD_S * np.stack([points[:, 1], -points[:, 0], np.zeros(len(points))], axis=1)
    turn_rad = flow.fitted(_shown(ground, points, points + turned), FREE_SD_RAD)[2]
    # A point that the ground carries from line to line is seen that much sooner or later than a frame later.
    ahead = np.array([1.0, 0.0, 0.0])
    step_m = SPEED_M_S * READOUT_S
    change = _line_times(ground, points - step_m * ahead) - _line_times(ground, points)
    stretched = -SPEED_M_S * change[:, None] * ahead
    travel_m = flow.fitted(_shown(ground, points, points + stretched), FREE_SD_RAD)[0]
    return RollingShutter(
        turn_delay=-float(turn_rad) / (RATE_RAD_S * READOUT_S),
        stretch_per_m=float(travel_m) / step_m / (SPEED_M_S * READOUT_S),
    )


def _line_times(ground: GroundPatch, points: np.ndarray) -> np.ndarray:
    """Return how much later than the middle line those of points are exposed, s."""
    pixels, _ = project(ground.rig, points)
    return READOUT_S * (pixels[:, 1] / (ground.rig.height - 1) - 0.5)


def _shown(ground: GroundPatch, points: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return by how much points seem displaced, ahead and left."""
    before, after = (seen_at(ground.rig, ground, each) for each in (points, moved))
    return (after - before) * (-1.0, 1.0)
