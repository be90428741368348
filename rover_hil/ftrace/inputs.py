"""What the commands on frames of a rear camera begin with: frames, calibration and telemetry."""

from pathlib import Path
from typing import NamedTuple

from controllers.ground_motion.rig import RigFile
from controllers.ground_motion.rig_tolerance import RigTolerance
from drivers.errors import ConfigError
from rover_hil.config import read_rig
from rover_hil.ftrace.frames import FrameSource
from rover_hil.ftrace.log_frames import LogFrames
from rover_hil.ftrace.telemetry import TelemetryRow, read_telemetry

LOG_SUFFIX = ".mcap"


class FrameInputs(NamedTuple):
    """Frames, calibration of their camera, and telemetry by frame number.

    Attributes:
        source: The frames.
        rig: Calibration of the camera.
        telemetry: By frame number; None without.
        is_of_rover: Whether the wheel speed is that of the rover; else that of the watched wheel.
    """

    source: FrameSource | LogFrames
    rig: RigFile
    telemetry: dict[int, TelemetryRow] | None
    is_of_rover: bool = False

    @property
    def tolerance(self) -> RigTolerance | None:
        """Return what is not known about the rig, by the log's configuration; None where it has another."""
        ground = self.source.ground if isinstance(self.source, LogFrames) else None
        return ground.tolerance if ground is not None and ground.rig == self.rig else None

    def row(self, number: int) -> TelemetryRow:
        """Return the telemetry of a frame; its time by the rate of the rig where there is none.

        Raises:
            ConfigError: The telemetry has no row for it.
        """
        if self.telemetry is None:
            return TelemetryRow(number / self.rig.image.fps, None, None)
        if number not in self.telemetry:
            raise ConfigError(f"the telemetry has no row for frame {number}: every frame needs one")
        return self.telemetry[number]


def read_inputs(frames: Path, rig_path: Path | None, telemetry_path: Path | None) -> FrameInputs:
    """Return what a drive consists of; a log holds all of it.

    Raises:
        ConfigError: A file is wrong or missing.
        LogError: The log cannot be read, or holds no frames.
    """
    given = None if rig_path is None else read_rig(rig_path)
    if frames.suffix == LOG_SUFFIX:
        if telemetry_path is not None:
            raise ConfigError(f"--telemetry: {frames} holds its own, leave the option out")
        log = LogFrames(frames)
        rig = given or log.rig
        if rig is None:
            raise ConfigError(f"{frames} holds no calibration of its camera: give its rig file with --rig")
        return FrameInputs(log, rig, log.telemetry, is_of_rover=True)
    if given is None:
        raise ConfigError("--rig is missing: give the rig file of the camera; only a log may hold its own")
    telemetry = None if telemetry_path is None else read_telemetry(telemetry_path)
    return FrameInputs(FrameSource(frames), given, telemetry)
