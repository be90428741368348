"""The measurements that correct the pose filter, each led back to the time when it was measured.

A reading of the gyro at standstill has no such time: `gyro.standstill_follower` takes the newest.
"""

from typing import Any

from controllers.estimation.filter.reader import Reader
from controllers.estimation.ground.follower import GroundFollower
from controllers.estimation.headings.heading import HeadingReader
from controllers.estimation.positions.frames import PositionFrames
from controllers.estimation.slip_compensator import SlipCompensator


def make_readers(
    positions: PositionFrames, ground: GroundFollower, slip: SlipCompensator | None
) -> tuple[Reader[Any], ...]:
    """Return the readers of all measurements; those of positions and ground keep the frames of devices."""
    return (HeadingReader(), positions, ground, *(() if slip is None else slip.readers))
