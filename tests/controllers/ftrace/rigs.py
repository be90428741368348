"""Rigs and rendered drives for tests of the trace estimator."""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from controllers.ftrace.estimator import Method, TraceAngle, TraceEstimator
from controllers.ground_motion.ground_patch import Floats
from controllers.ground_motion.rig import RigFile, RigGeometry
from drivers.clock import nanoseconds
from drivers.samples import Image
from tests.rear_scene.sequence import FrameSequence
from tests.rear_scene.truth import Telemetry
from tests.sim_backends.rear_drives import rig

LENS = (-0.2, 0.03, 5e-4, -4e-4, 0.004)


def geometry(steer_deg: float = 0.0, distortion: tuple[float, ...] = LENS, scale: float = 1.0) -> RigGeometry:
    """Return the rig of the scene's tests, with its wheel steered, or in a picture `scale` times as large."""
    table = RigFile.model_validate(rig(distortion).as_json()).geometry()
    size = np.diag([scale, scale, 1.0])
    return replace(
        table,
        steer_rad=math.radians(steer_deg),
        camera_matrix=size @ table.camera_matrix,
        width=round(scale * table.width),
        height=round(scale * table.height),
    )


def grey_frames(sequence: FrameSequence) -> list[Image]:
    """Render a drive."""
    return [np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8) for image in sequence.frames()]


def rates(row: Telemetry) -> tuple[float, float, float]:
    """Return turn rates in rad/s."""
    return (
        math.radians(row.gyro_roll_dps),
        math.radians(row.gyro_pitch_dps),
        math.radians(row.gyro_yaw_dps),
    )


def follow(
    sequence: FrameSequence, images: Sequence[Image], method: Method, *, telemetry: bool = True
) -> list[TraceAngle]:
    """Return what the estimator says of a drive's frames, one for each."""
    estimator = TraceEstimator(RigFile.model_validate(sequence.rig.as_json()).geometry(), method)
    return [
        estimator.step(
            nanoseconds(row.t),
            image,
            wheel_speed_m_s=row.wheel_speed_mps if telemetry else None,
            rates_rad_s=rates(row) if telemetry else None,
        )
        for image, row in zip(images, sequence.telemetry, strict=False)
    ]


def errors_deg(sequence: FrameSequence, angles: Sequence[TraceAngle], name: str = "theta_t_deg") -> Floats:
    """Return errors of the angles found where a trace is present, against a column of the truth."""
    return np.array(
        [
            angle.theta_deg - getattr(truth, name)
            for angle, truth in zip(angles, sequence.truth, strict=False)
            if truth.trace_present and angle.detected
        ]
    )


def rms(values: Floats) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
