"""What the trace estimator reads in a frame."""

from dataclasses import dataclass

Rates = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceReading:
    """The trace in one frame.

    Attributes:
        t_ns: Time of exposure.
        detected: The trace is detected in this frame.
        theta_rad: Angle of the wheel's current velocity from its axis, counter-clockwise; None without a
            source.
        confidence: 0..1, probability that the wheel's own trace is in this frame, at least 0.20 m of it, and
            that `theta_rad` is right within 5 deg. It is also given where no trace is detected.
        source: Where the angle comes from. `trace`: the trace, with the motion of the ground; `flow`: the
            motion of the ground and the gyro alone, no trace is detected; `held`: neither, the direction is
            predicted for a short while, or in the first frame that of what looks like a trace; `none`: there
            is none.
        theta_sd_rad: Standard deviation of `theta_rad`; None where unknown (`hough`, and without a source).
        mounting_sd_rad: Standard deviation of what all angles share and `theta_sd_rad` leaves out, the yaw of
            the camera's mounting. None without a check of it (`hough`).
        contradiction: What pictures and gyro show to be wrong about the rig: there is no angle then; "" for
            nothing.
    """

    t_ns: int
    detected: bool
    theta_rad: float | None
    confidence: float
    source: str
    theta_sd_rad: float | None
    mounting_sd_rad: float | None = None
    contradiction: str = ""
