"""Angle of the current velocity of a rear wheel from the trace it leaves (paper 000, section 2)."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from controllers.ftrace.frame import Frame, Reading, is_usable
from controllers.ftrace.hough.tracker import HoughTracker
from controllers.ftrace.parameters import DEFAULTS, FTraceParameters
from controllers.ftrace.reading import Rates, TraceReading
from controllers.ftrace.rut.tracker import RutTracker
from controllers.ground_motion.ground_patch import Floats, GroundPatch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.pair_sum import PairSum
from controllers.ground_motion.prior import turned
from controllers.ground_motion.rig import RigGeometry
from controllers.ground_motion.rig_tolerance import RigTolerance
from drivers.clock import seconds
from drivers.errors import ConfigError, ModelError
from drivers.samples import FrameSample, Image

Method = Literal["fused", "hough"]
Source = Literal["trace", "flow", "held", "none"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceAngle(TraceReading):
    """Estimate after a frame: the reading, and where the trace lies.

    Attributes:
        offset_m: Place of the trace at the contact, left of it positive; for a travel of `parameters.kept_m`
            after the last trace that of the kept path; None without one.
        distance_m: Distance of the trace's line from the vehicle's origin, positive when it passes left of it
            (the paper's d_t); None like `offset_m`.
        path_m: Centre line of the trace in the vehicle frame, rows of x, y, z; empty without one.
    """

    offset_m: float | None
    distance_m: float | None
    path_m: Floats

    @property
    def theta_deg(self) -> float:
        """`theta_rad` in degrees; NaN where unknown."""
        return float("nan") if self.theta_rad is None else float(np.degrees(self.theta_rad))


class TraceEstimator:
    """Follows the trace from frame to frame.

    Args:
        rig: Calibrated camera and wheel.
        method: `fused`: cross-sections of the rut, the path travelled, and the optical flow of the ground;
            `hough`: the paper's method, Hough lines and fuzzy reasoning.
        parameters: Tuned numbers.
        tolerance: What is not known about the rig; None for its defaults.
        pairs: The motion over the ground that somebody else measures, in each frame before it comes here;
            None to measure it here.

    Raises:
        ConfigError: The rig watches no wheel, or the camera does not see the ground behind it.
    """

    def __init__(
        self,
        rig: RigGeometry,
        method: Method = "fused",
        parameters: FTraceParameters = DEFAULTS,
        tolerance: RigTolerance | None = None,
        pairs: PairSum | None = None,
    ) -> None:
        if not rig.watches_wheel:
            raise ConfigError("the rig watches no wheel, so there is no trace: describe `wheel` in the rig")
        self._rig = rig
        self._parameters = parameters
        if pairs is None:
            self._view = GroundView(GroundPatch(rig), parameters.ground_motion.structure)
        else:
            self._view = pairs.view
        self._ground = self._view.ground
        self._tracker: HoughTracker | RutTracker = (
            HoughTracker(self._view, parameters)
            if method == "hough"
            else RutTracker(self._view, parameters, tolerance or RigTolerance(), pairs)
        )
        self._missed_m = self._unmeasured_m = math.inf  # travel of the wheel since
        self._confidence = 0.0
        self._t_ns: int | None = None
        self._rates: Rates | None = None

    def step(
        self,
        t_ns: int,
        image: Image,
        *,
        wheel_speed_m_s: float | None = None,
        rates_rad_s: Rates | None = None,
    ) -> TraceAngle:
        """Take the next frame.

        Args:
            t_ns: Time of exposure.
            image: Grey or BGR pixels, of the rig's size.
            wheel_speed_m_s: Speed of the wheel's rim; None for the rig's nominal speed.
            rates_rad_s: Turn rates of the body about x, y, z, or None.

        Raises:
            ModelError: Time does not increase, or the frame has another size than the rig's.
        """
        frame = self._frame(t_ns, image, wheel_speed_m_s, rates_rad_s)
        reading = self._tracker.track(frame)
        kept_m, travel_m, before_m = self._parameters.kept_m, abs(frame.travel_m), self._missed_m
        self._missed_m = 0.0 if reading.found else self._missed_m + travel_m
        is_measured = reading.found or reading.by_motion
        self._unmeasured_m = 0.0 if is_measured else self._unmeasured_m + travel_m
        if before_m <= kept_m < self._missed_m:
            self._tracker.lose()
        source = self._source(reading)
        theta = None if source == "none" else reading.theta_rad
        # Evidence against the trace counts; a frame without any halves what was known before.
        has_evidence = reading.found or reading.confidence > 0
        self._confidence = reading.confidence if has_evidence else self._confidence / 2
        line = None if theta is None or self._missed_m > kept_m else (theta, reading.offset_m)
        return TraceAngle(
            t_ns=t_ns,
            detected=reading.found and source != "none",
            theta_rad=theta,
            theta_sd_rad=None if theta is None else reading.theta_sd_rad,
            source=source,
            offset_m=None if line is None else line[1],
            distance_m=None if line is None else self._distance(*line),
            confidence=0.0 if source == "none" else self._confidence,
            path_m=np.zeros((0, 3)) if line is None else self._ground.to_vehicle(*reading.path_m.T),
            mounting_sd_rad=reading.mounting_sd_rad,
            contradiction=reading.contradiction,
        )

    def find(
        self, frame: FrameSample, wheel_speed_m_s: float, rates_rad_s: Rates | None
    ) -> TraceReading | None:
        """Return the reading of a frame; None for one of another size, or not newer than the one before."""
        t_ns = frame.t_ns if frame.t_capture_ns is None else frame.t_capture_ns
        is_late = self._t_ns is not None and t_ns <= self._t_ns
        if is_late or frame.image.shape[:2] != (self._rig.height, self._rig.width):
            return None
        found = self.step(t_ns, frame.image, wheel_speed_m_s=wheel_speed_m_s, rates_rad_s=rates_rad_s)
        return TraceReading(
            t_ns=t_ns,
            detected=found.detected,
            theta_rad=found.theta_rad,
            confidence=found.confidence,
            source=found.source,
            theta_sd_rad=found.theta_sd_rad,
            mounting_sd_rad=found.mounting_sd_rad,
            contradiction=found.contradiction,
        )

    def _source(self, reading: Reading) -> Source:
        """Return the source of the angle."""
        if reading.theta_rad is None or reading.contradiction:
            return "none"
        if reading.found:
            return "trace"
        if reading.by_motion:
            return "flow"
        return "held" if self._unmeasured_m <= self._parameters.kept_m else "none"

    def _frame(self, t_ns: int, image: Image, speed_m_s: float | None, rates: Rates | None) -> Frame:
        if self._t_ns is not None and t_ns <= self._t_ns:
            raise ModelError(
                f"frame time {t_ns} ns is not after the one before, {self._t_ns} ns: give frames in order"
            )
        ground = self._view.look(image)
        dt_s = 0.0 if self._t_ns is None else seconds(t_ns - self._t_ns)
        speed = self._rig.nominal_speed_m_s if speed_m_s is None else speed_m_s
        turn, turn_sd = turned(rates, self._rates, dt_s, self._parameters.ground_motion.turn)
        frame = Frame(
            t_ns=t_ns,
            ground=ground,
            usable=is_usable(ground.patch, self._ground.visible, self._parameters.frame),
            travel_m=speed * dt_s,
            turn_rad=turn,
            turn_sd_rad=turn_sd,
            has_gyro=rates is not None and self._rates is not None,
        )
        self._t_ns, self._rates = t_ns, rates
        return frame

    def _distance(self, theta_rad: float, offset_m: float) -> float:
        """Return the distance of the trace's line from the origin, positive where it passes left of it."""
        direction = theta_rad + self._rig.steer_rad
        x, y = self._ground.to_vehicle(np.zeros(1), np.full(1, offset_m))[0, :2]
        return float(y * np.cos(direction) - x * np.sin(direction))
