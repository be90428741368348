"""The trace estimator on the frames of a running rover."""

from controllers.ftrace.estimator import TraceEstimator
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.rig import RigFile
from controllers.slip.scomp.compensator import Rates, TraceReading
from drivers.camera.settings import CameraSettings
from drivers.errors import ConfigError
from drivers.samples import FrameSample


class LiveTraceFinder:
    """Feeds the trace estimator; never raises on a frame.

    Args:
        rig: Calibration of the camera.
        camera: The camera of the rig.
        view: The ground in its frames, for others that look at it too; None for one of its own.

    Raises:
        ConfigError: The camera does not see the ground behind the wheel, or its frames have another size.
    """

    def __init__(self, rig: RigFile, camera: CameraSettings, view: GroundView | None = None) -> None:
        conflict = rig.size_conflict(camera.width, camera.height)
        if conflict:
            raise ConfigError(conflict)
        self._estimator = TraceEstimator(rig.geometry(), view=view)
        self._shape = (rig.image.height, rig.image.width)
        self._before_ns: int | None = None

    def find(
        self, frame: FrameSample, wheel_speed_m_s: float, rates_rad_s: Rates | None
    ) -> TraceReading | None:
        """Return the reading of a frame; None for one of another size, or not newer than the one before."""
        t_ns = frame.t_ns if frame.t_capture_ns is None else frame.t_capture_ns
        if frame.image.shape[:2] != self._shape or (self._before_ns is not None and t_ns <= self._before_ns):
            return None
        self._before_ns = t_ns
        found = self._estimator.step(
            t_ns, frame.image, wheel_speed_m_s=wheel_speed_m_s, rates_rad_s=rates_rad_s
        )
        return TraceReading(
            t_ns=t_ns,
            detected=found.detected,
            theta_rad=found.theta_rad,
            confidence=found.confidence,
            source=found.source,
            theta_sd_rad=found.theta_sd_rad,
        )
