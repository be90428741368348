"""The rows of a recorded drive as samples, and the estimator that takes them."""

import math
from collections.abc import Iterator

import numpy as np

from controllers.estimation.ground_assumption.assumption import SlipAssumption
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_prior import SlipPrior
from controllers.estimator import Estimator
from controllers.ftrace.reading import Rates, TraceReading
from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import RoverSettings, SkidSteerRoverSettings, WheelsRoverSettings
from controllers.motion.wheel_settings import SteeringSettings, WheelSettings
from controllers.roles import DeviceRoles
from controllers.slip.scomp.compensator import ScompCompensator
from controllers.slip.scomp.parameters import RoverGeometry, ScompParameters
from controllers.slip.scomp.settings import ScompSettings
from controllers.slip.scomp.states import ScompStates
from drivers.clock import nanoseconds
from drivers.samples import (
    UNKNOWN_YAW_STD_RAD,
    AttitudeSample,
    FrameSample,
    HeadingReference,
    HeadingSample,
    PoseFixSample,
    RateSample,
    Sample,
    WheelSample,
)
from rover_hil.scomp.drive import SensorRows

WHEELS, GYRO, COMPASS, CAMERA, FIXES = "wheels", "gyro", "compass", "camera", "fixes"
START_NS = nanoseconds(1.0)
START_SD = 1e-3
"""Of the pose at the start in its own frame, m and rad."""
FIX_SD_M = 0.05
"""Of an absolute position in a table."""
ROWS_OF_SILENCE = 1.5
"""A sensor is silent after so many of the drive's longest rows."""


class RecordedTrace:
    """A finder that returns the recorded trace of a frame.

    Attributes:
        reading: Of the frame that arrives next.
    """

    def __init__(self) -> None:
        self.reading: TraceReading | None = None

    def find(
        self, frame: FrameSample, wheel_speed_m_s: float, rates_rad_s: Rates | None
    ) -> TraceReading | None:
        """Return the recorded trace."""
        return self.reading


class RecordedSamples:
    """Samples of the rows of a drive.

    Args:
        drive: The log.
        parameters: Signs of the compass.
        start_rad: Heading at the start in the frame of the fixes; None where it is along x.
    """

    def __init__(self, drive: SensorRows, parameters: ScompParameters, start_rad: float | None) -> None:
        self.drive = drive
        self.trace = RecordedTrace()
        self._compass_sign = parameters.compass.sign or 1
        self._start_rad = start_rad or 0.0
        self._start_sd_rad = START_SD if start_rad is None else parameters.compass.offset_sd_rad

    @property
    def roles(self) -> DeviceRoles:
        """The sensors that the drive has."""
        drive = self.drive
        measured = (drive.gyro_rad_s, drive.pitch_rad, drive.roll_rad)  # the gyro measures the tilt, too
        age_s = ROWS_OF_SILENCE * float(np.diff(drive.t_s).max())
        return DeviceRoles(
            wheels=WHEELS,
            required={WHEELS: age_s, GYRO: age_s},
            gyro=GYRO if any(x is not None for x in measured) else None,
            headings=() if drive.compass_rad is None else (COMPASS,),
            fixes=() if drive.fix_m is None else (FIXES,),
            camera=None if drive.trace_rad is None else CAMERA,
        )

    def t_ns(self, row: int) -> int:
        """Return the time of a row."""
        return START_NS + nanoseconds(float(self.drive.t_s[row] - self.drive.t_s[0]))

    def of_row(self, row: int) -> Iterator[Sample]:
        """Yield what arrives with a row."""
        drive, t_ns = self.drive, self.t_ns(row)
        steering_rad = None if drive.steering_rad is None else float(drive.steering_rad[row])
        for wheel, side in enumerate((-1.0, 1.0, -1.0, 1.0)):
            yield WheelSample(
                device=WHEELS,
                t_ns=t_ns,
                wheel=wheel,
                position_rad=float(drive.wheel_rad[row] + side * drive.wheel_yaw_rad[row]),
                steering_rad=steering_rad,
            )
        if drive.gyro_rad_s is not None:
            yield RateSample(device=GYRO, t_ns=t_ns, rate_z_rad_s=float(drive.gyro_rad_s[row]))
        if drive.pitch_rad is not None or drive.roll_rad is not None:
            yield AttitudeSample(
                device=GYRO,
                t_ns=t_ns,
                pitch_rad=0.0 if drive.pitch_rad is None else -float(drive.pitch_rad[row]),
                roll_rad=0.0 if drive.roll_rad is None else float(drive.roll_rad[row]),
            )
        if drive.compass_rad is not None and math.isfinite(drive.compass_rad[row]):
            yield HeadingSample(
                device=COMPASS,
                t_ns=t_ns,
                heading_rad=self._compass_sign * float(drive.compass_rad[row]),
                reference=HeadingReference.MAGNETIC,
            )
        if drive.trace_rad is not None and math.isfinite(drive.trace_rad[row]):
            self.trace.reading = TraceReading(
                t_ns=t_ns,
                detected=True,
                theta_rad=float(drive.trace_rad[row]),
                confidence=1.0,
                source="trace",
                theta_sd_rad=None,
            )
            image = np.zeros((1, 1), np.uint8)
            yield FrameSample(device=CAMERA, t_ns=t_ns, t_capture_ns=None, index=row, image=image)
        if drive.fix_m is not None:
            yield from self._fixes(drive.fix_m[row], t_ns, is_start=row == 0)

    def _fixes(self, fix_m: np.ndarray, t_ns: int, *, is_start: bool) -> Iterator[Sample]:
        """Yield the fix of a row; at the start one that ties the frame of the fixes to the rover."""
        if is_start:
            yield PoseFixSample(
                device=FIXES,
                t_ns=t_ns,
                t_capture_ns=t_ns,
                x_m=0.0,
                y_m=0.0,
                yaw_rad=self._start_rad,
                position_std_m=START_SD,
                yaw_std_rad=self._start_sd_rad,
            )
        elif np.isfinite(fix_m).all():
            yield PoseFixSample(
                device=FIXES,
                t_ns=t_ns,
                t_capture_ns=t_ns,
                x_m=float(fix_m[0]),
                y_m=float(fix_m[1]),
                yaw_rad=0.0,
                position_std_m=FIX_SD_M,
                yaw_std_rad=UNKNOWN_YAW_STD_RAD,
            )


def recorded_estimator(
    samples: RecordedSamples, parameters: ScompParameters, settings: FilterSettings, states: ScompStates
) -> Estimator:
    """Return the estimator of the control loop for a recorded drive."""
    drive, roles = samples.drive, samples.roles
    kinematics = make_kinematics(_rover(parameters.rover, is_steered=drive.steering_rad is not None))
    scomp = ScompSettings(parameters=parameters, frame_period_s=0.0)
    slip = ScompCompensator(scomp, roles, kinematics, None if roles.camera is None else samples.trace, states)
    fastest_rad_s = float(
        np.abs(np.diff(drive.wheel_rad) / np.diff(drive.t_s)).max()
        + np.abs(np.diff(drive.wheel_yaw_rad) / np.diff(drive.t_s)).max()
    )
    no_slip = SlipPrior("none", 0.0, 0.0, 0.0, 1.0, 0.0)  # that of the slip law is part of the states
    return Estimator(
        kinematics,
        settings,
        1.0 + fastest_rad_s,
        roles,
        slip,
        assumption=SlipAssumption(no_slip, no_slip),
    )


def _rover(rover: RoverGeometry, *, is_steered: bool) -> RoverSettings:
    """Return a rover with four wheels; where they steer, they do so together."""
    if not is_steered:
        return SkidSteerRoverSettings(
            kinematics="skid_steer_4", wheel_radius_m=rover.wheel_radius_m, track_m=rover.track_m
        )
    half_m = 0.5 * rover.track_m
    steering = SteeringSettings(low_deg=-180.0, high_deg=180.0)
    return WheelsRoverSettings(
        kinematics="wheels",
        wheels=tuple(
            WheelSettings(x_m=x_m, y_m=y_m, radius_m=rover.wheel_radius_m, steering=steering)
            for x_m in (half_m, -half_m)
            for y_m in (half_m, -half_m)
        ),
    )
