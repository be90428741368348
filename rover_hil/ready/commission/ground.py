"""What a commissioning learns of the slip of its ground, for `[ground] slip = "learned"`."""

import cmath
import math
from collections.abc import Iterator, Sequence

import numpy as np

from rover_hil.drives.marks import Marks
from rover_hil.drives.quality.learned_ground import LearnedGround, ground_of
from rover_hil.ready.commission.drive import Poses
from rover_hil.ready.commission.worth import LEAST_LEG_M


def learn_ground(drives: Sequence[tuple[Poses, Marks]]) -> LearnedGround | None:
    """Return the slip of a ground by marks measured by hand; None for too few straight legs."""
    return ground_of(np.array([share for poses, marks in drives for share in _shares(poses, marks)]))


def _shares(poses: Poses, marks: Marks) -> Iterator[complex]:
    """Yield the travel between marks over that of the wheels, in the body frame, left as imaginary part.

    Only legs at whose end the yaw was measured: both travels are turned by their own yaw there.
    """
    place = poses.at(0.0)
    before_m, wheels_before_m = 0j, complex(*poses.odometry[place, :2])
    for number, t_s in enumerate(marks.t_s.tolist()):
        place = poses.at(t_s)
        here_m = complex(marks.x_m[number], marks.y_m[number])
        wheels_m = complex(*poses.odometry[place, :2])
        leg_m, rolled_m = here_m - before_m, wheels_m - wheels_before_m
        before_m, wheels_before_m = here_m, wheels_m
        yaw_rad = math.radians(float(marks.yaw_deg[number]))
        if abs(rolled_m) < LEAST_LEG_M or not math.isfinite(yaw_rad):
            continue
        turned = cmath.rect(1.0, float(poses.odometry[place, 2]) - yaw_rad)
        yield leg_m * turned / rolled_m
