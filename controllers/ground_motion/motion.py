"""Motion of the rover over the ground between two frames."""

from dataclasses import dataclass
from typing import NamedTuple

from controllers.fault import Fault

Rates = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundMotion:
    """What a pair of frames shows about the rover's motion.

    The motion is that of `point_m` over the ground, in the vehicle's axes of the later frame. An error has
    two parts: one of this pair, and one in proportion to the travel that all pairs share (height, pitch and
    yaw of the camera, sinkage, focal length). The second part does not average: sums keep it.

    Attributes:
        from_ns: Time of the earlier frame, middle of its exposure.
        to_ns: Time of the later frame.
        point_m: The point of the vehicle frame that moved, forward and left.
        foot_m: The point below the camera, likewise: about it a wrong height scales the view.
        forward_m: Travel along the vehicle's x axis; negative backwards.
        left_m: Travel to its left.
        turn_rad: Turn, counter-clockwise.
        forward_sd_m: Standard deviation of `forward_m`, the part of this pair.
        left_sd_m: Standard deviation of `left_m`, the part of this pair.
        turn_sd_rad: Standard deviation of `turn_rad`.
        scale_sd: Standard deviation of the shared factor of the travel, 1.
        direction_sd_rad: Standard deviation of the shared direction of the travel, 0.
        rig_fault: What contradicts the rig, and by how much the travel of all earlier pairs may be wrong by
            it; None for nothing.
        unconfirmed: What the drive has not confirmed about the rig so far, and how it does, and which motion
            the ground leaves open; "" for nothing. It is no fault: `scale_sd` holds the first, and a pair for
            which the second matters is not valid.
        invalid_because: Why the pair measures nothing; "" where it is valid. The motion is then 0.
        is_open: The frame was left out, and the next pair begins at `from_ns`, too.
    """

    from_ns: int
    to_ns: int
    point_m: tuple[float, float]
    foot_m: tuple[float, float]
    forward_m: float
    left_m: float
    turn_rad: float
    forward_sd_m: float
    left_sd_m: float
    turn_sd_rad: float
    scale_sd: float
    direction_sd_rad: float
    rig_fault: Fault | None = None
    unconfirmed: str = ""
    invalid_because: str = ""
    is_open: bool = False

    @property
    def is_valid(self) -> bool:
        """Return whether the pair measures the motion."""
        return not self.invalid_because


class WheelPrior(NamedTuple):
    """Motion of the measured point between two frames if the wheels rolled, in the axes of the later frame.

    Attributes:
        turn_rad: By the source of the yaw.
        rates_rad_s: Newest turn rates of the body about x, y, z; None where unknown.
    """

    forward_m: float
    left_m: float
    turn_rad: float
    rates_rad_s: Rates | None
