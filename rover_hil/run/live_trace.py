"""The trace estimator on the frames of a running rover."""

from collections.abc import Mapping

import cv2
import numpy as np
from pydantic import JsonValue, ValidationError

from controllers.ftrace.estimator import TraceEstimator, TraceSettings
from controllers.slip.scomp.compensator import Rates, TraceReading
from drivers.camera.settings import CameraSettings
from drivers.errors import ConfigError
from drivers.samples import FrameSample
from rover_hil.config import describe_validation_error
from rover_hil.ftrace.rig_file import RigFile


class LiveTraceFinder:
    """Feeds the trace estimator; never raises on a frame.

    Args:
        rig: Content of the rig file.
        camera: The camera of the rig.

    Raises:
        ConfigError: The rig is invalid, or its frames have another size than those of the camera.
    """

    def __init__(self, rig: Mapping[str, JsonValue], camera: CameraSettings) -> None:
        try:
            checked = RigFile.model_validate(rig)
        except ValidationError as error:
            raise ConfigError(describe_validation_error("scomp.rig", error, rig)) from error
        size, wanted = (checked.image.width, checked.image.height), (camera.width, camera.height)
        if size != wanted:
            msg = f"scomp.rig has frames of {size} pixels, the camera gives {wanted}: make them equal"
            raise ConfigError(msg)
        self._estimator = TraceEstimator(checked.geometry(), TraceSettings())
        self._shape = size[::-1]
        self._before_ns: int | None = None

    def find(
        self, frame: FrameSample, wheel_speed_m_s: float, rates_rad_s: Rates | None
    ) -> TraceReading | None:
        """Return the trace in a frame; None for a frame of another size, or not newer than the last one."""
        t_ns = frame.t_ns if frame.t_capture_ns is None else frame.t_capture_ns
        if frame.image.shape[:2] != self._shape or (self._before_ns is not None and t_ns <= self._before_ns):
            return None
        self._before_ns = t_ns
        image = frame.image
        grey = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
        found = self._estimator.step(t_ns, grey, wheel_speed_m_s=wheel_speed_m_s, rates_rad_s=rates_rad_s)
        return TraceReading(
            t_ns=t_ns, detected=found.detected, theta_rad=found.theta_rad, confidence=found.confidence
        )
