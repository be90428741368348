"""Parameters of rover, ground and sensors, and every tuned number of the filter.

`rover-hil identify scomp` fits `ScompParameters` to a drive. The numbers of `SCOMP` were chosen by hand, no
record of the data; a result's sensitivity to each is printed by
`python -m benchmarks.sensitivity scomp`.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from controllers.slip.scomp.combined_slip import CombinedSlip
from controllers.slip.scomp.two_segment_slip_law import TwoSegmentSlip
from drivers.settings import Settings

Share = Annotated[float, Field(ge=0.0, le=2.0)]
Spread = Annotated[float, Field(gt=0.0, le=3.2)]
Seconds = Annotated[float, Field(ge=0.01, le=100.0)]
Angle = Annotated[float, Field(ge=-math.tau, le=math.tau)]
Sign = Literal[-1, 1]

PAPER_TWO_SEGMENT_SLIP = TwoSegmentSlip(
    slip_0=0.3118, k_per_rad=0.186, beta_0_rad=math.radians(6.4), fit_range_rad=(0.0, math.radians(25.0))
)


class RoverGeometry(Settings):
    """The rover El-Dorado of paper 000; values that are not in the paper are marked.

    Attributes:
        wheel_radius_m: r^w, that of the single-wheel tests.
        rear_axle_m: b, from the rear axle to the centre of mass; not in the paper, chosen.
        track_m: Between left and right wheels; not in the paper, chosen. Used where there is no gyro.
    """

    wheel_radius_m: Annotated[float, Field(ge=0.005, le=1.0)] = 0.092
    rear_axle_m: Annotated[float, Field(ge=-2.0, le=2.0)] = 0.30
    track_m: Annotated[float, Field(ge=0.05, le=5.0)] = 0.44


class SlipFromPitch(Settings):
    """Slip by eqs 5-9 from the traction R_x = W (sin(pitch) + c_rr).

    Attributes:
        model: The ground under a wheel.
        rolling_resistance: c_rr.
        rolling_resistance_sd: Standard deviation of c_rr.
        stiffness_sd: Standard deviation of the logarithm of `model.c_x_n` for a given c_rr.
        stiffness_follows: Increase of that logarithm per c_rr at the slip of the fitted drive: a drive
            determines the two together better than each.
        fluctuation: Standard deviation of the slip about the model.
        fluctuation_time_s: Its correlation time.
        pitch_sign: 1 where a raised nose is positive in the log, -1 where it is negative.
    """

    model: CombinedSlip = CombinedSlip()
    rolling_resistance: Annotated[float, Field(ge=-0.2, le=0.6)] = 0.05
    rolling_resistance_sd: Spread = 0.04
    stiffness_sd: Spread = 0.4
    stiffness_follows: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    fluctuation: Share = 0.06
    fluctuation_time_s: Seconds = 3.0
    pitch_sign: Sign = 1


class DriftFromRoll(Settings):
    """Slip angle expected from the roll: `gain` times that of eqs 5-9 for the weight's sideways part.

    Attributes:
        gain: 0 where the roll explains nothing.
        gain_sd: Standard deviation of the gain on other ground.
        rest: Standard deviation of the slip angle about the expected one, rad.
        rest_time_s: Its correlation time.
        alone: Standard deviation of the whole slip angle, for drives without roll, rad.
        alone_time_s: Its correlation time.
    """

    gain: Annotated[float, Field(ge=-10.0, le=10.0)] = 1.0
    gain_sd: Share = 0.7
    rest: Spread = math.radians(5.0)
    rest_time_s: Seconds = 4.0
    alone: Spread = math.radians(6.0)
    alone_time_s: Seconds = 8.0


class CompassModel(Settings):
    """Compass: reading = offset + heading (or minus heading), lagged, with a deviation over the heading.

    Attributes:
        sign: 1 where readings are positive counter-clockwise, as yaw is; -1 where clockwise.
        offset_rad: Reading at heading zero in the frame of the truth; None where unknown.
        offset_sd_rad: Its standard deviation.
        reference_rad: Heading at which the offset was measured; the deviation is zero there.
        lag_s: First-order lag.
        noise_rad: White noise of a reading.
        deviation_rad: Size of each of the harmonics sin, cos, sin 2, cos 2 of the deviation over the heading.
    """

    sign: Sign | None = None
    offset_rad: Angle | None = None
    offset_sd_rad: Spread = math.radians(2.0)
    reference_rad: Angle = 0.0
    lag_s: Annotated[float, Field(ge=0.0, le=5.0)] = 0.45
    noise_rad: Spread = math.radians(0.5)
    deviation_rad: Spread = math.radians(1.0)


class GyroModel(Settings):
    """Noise of the yaw gyro.

    Attributes:
        bias_rad_s: Standard deviation of the bias at start.
        walk_rad_sqrt_s: Of the integrated rate after one second.
        bias_walk_rad_s_sqrt_s: Of the bias' change within one second.
    """

    bias_rad_s: Spread = math.radians(0.5)
    walk_rad_sqrt_s: Spread = math.radians(0.05)
    bias_walk_rad_s_sqrt_s: Spread = math.radians(0.002)


class TraceModel(Settings):
    """Measurement of the trace angle of the rear left wheel.

    Attributes:
        sign: 1 where a velocity to the left of the wheel's axis is positive.
        offset_rad: Constant error, from the camera's mounting.
        offset_sd_rad: Its standard deviation.
        noise_rad: Standard deviation of the correlated noise.
        noise_time_s: Its correlation time.
    """

    sign: Sign = 1
    offset_rad: Angle = 0.0
    offset_sd_rad: Spread = math.radians(0.5)
    noise_rad: Spread = math.radians(1.5)
    noise_time_s: Seconds = 0.4


class Provenance(Settings):
    """Names of the log and the truth that the parameters were fitted to, and the day of the fit."""

    log: str = "defaults"
    truth: str = ""
    fitted_on: str = ""


class ScompParameters(Settings):
    """The file that `rover-hil identify scomp` writes.

    Attributes:
        starts_along_x: The frame of the truth has its origin at the rover's start and x ahead. Then a compass
            that agrees within its offset does not change the heading at start.
        two_segment_slip: Eq 12; key `hinge` in the file. Used where there is no pitch.
    """

    model_config = ConfigDict(populate_by_name=True)

    schema_name: Annotated[Literal["rover-hil-scomp/1"], Field(alias="schema")] = "rover-hil-scomp/1"
    starts_along_x: bool = True
    provenance: Provenance = Provenance()
    rover: RoverGeometry = RoverGeometry()
    two_segment_slip: Annotated[TwoSegmentSlip, Field(alias="hinge")] = PAPER_TWO_SEGMENT_SLIP
    pitch: SlipFromPitch = SlipFromPitch()
    roll: DriftFromRoll = DriftFromRoll()
    compass: CompassModel = CompassModel()
    gyro: GyroModel = GyroModel()
    trace: TraceModel = TraceModel()


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionParameters:
    """Steps and noise of the prediction."""

    step_s: float = 0.05  # least step while driving: the states change slowly, and each step costs time
    first_walk_sqrt_m: float = 0.004  # change of the slip law's first parameter per square root of distance
    largest_drift_rad: float = 1.3  # bound of the slip angle
    tilt_memory_s: float = 0.5  # time constant of the low-pass on pitch and roll
    tilt_age_s: float = 1.0  # after this time without a reading pitch and roll are unknown


@dataclass(frozen=True, slots=True, kw_only=True)
class CorrectionParameters:
    """Corrections by the trace."""

    slowest_m_s: float = 0.01  # below this speed a trace has no direction
    rate_memory_s: float = 0.3  # before the exposure: the trace is compared with the mean motion in this time
    rate_age_s: float = (
        0.5  # after this time without the gyro it is unknown whether the wheels skid in a turn
    )
    trace_grain_rad: float = math.radians(0.3)  # white noise of a trace angle
    turn_memory_s: float = 0.5  # time constant of the skidding that follows
    greatest_skid: float = (
        0.15  # wheels skid in a turn by this share of their speed: the slip law does not hold
    )
    trace_rejected_s: float = 0.35  # of rejected traces alone, before the slip angle is taken from the trace
    confirming_s: float = 1.9  # of accepted traces after that, before the slip angle is sure again
    blind_m: float = (
        0.3  # of the wheels without a direction in any frame: the camera does not see the ground move
    )
    blind_s: float = 1.7  # at least, from the first frame without a direction to the newest


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterParameters:
    """All tuned numbers, by their part of the filter."""

    motion: MotionParameters = MotionParameters()
    correction: CorrectionParameters = CorrectionParameters()


SCOMP = FilterParameters()
