"""A recorded drive: the log of a run or of an import, for everything that works on it afterwards."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from controllers.motion.kinematics import make_kinematics
from drivers.link import CameraImage
from rover_hil.config import Config
from rover_hil.drives.arrays import Array, Times
from rover_hil.drives.channels import Channels
from rover_hil.drives.ground_truth import TruePoses, measured_poses, true_poses
from rover_hil.recording import schema
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.images import capture_time_ns, decode_image
from rover_hil.recording.reader import LogMessage, LogReader

DEGREES = {
    "heading_rad": "heading_deg",
    "gyro_z_rad_s": "yaw_rate_deg_s",
    "pitch_rad": "pitch_deg",
    "roll_rad": "roll_deg",
    "trace_rad": "beta_ftrace_deg",
    "steering_rad": "steering_deg",
}
"""Columns of a table that are in degrees, as in CSV files of drives."""
SINGLE = ("heading_rad", "trace_rad")
"""In a table these stay single readings; setpoints are held, all else is interpolated."""
SET_POINT = "set"

TakeSamples = Callable[[int, schema.SamplesRecord], None]
"""Gets the time of a cycle, and what was measured in it."""
TakeEstimate = Callable[[int, schema.EstimateRecord], None]
"""Gets the time of a cycle, and what it computed."""


class Drive:
    """A recorded drive.

    Pictures and raw bytes are read when they are asked for, one after the other; the channels after `read`.

    Args:
        path: Of the log.
        with_traces: Read trace and steering angles too.
        with_devices: Read all inertial sensors and headings too.

    Attributes:
        log: The log.
        name: Of the drive, for results.
        config: Its configuration; files that it names are not there.
        channels: What was measured.

    Raises:
        LogError: The log cannot be read, or its configuration is not valid for this version.
    """

    def __init__(self, path: Path, *, with_traces: bool = False, with_devices: bool = False) -> None:
        self.log = LogReader(path)
        self.name = path.stem
        with restore_config(self.log) as config:
            self.config: Config = config
            self.channels = Channels(config, with_traces=with_traces, with_devices=with_devices)

    def read(
        self, take_samples: TakeSamples | None = None, take_estimate: TakeEstimate | None = None
    ) -> "Drive":
        """Read the log to its end; return this drive.

        Args:
            take_samples: Is called for each cycle, where the channels are not enough.
            take_estimate: Likewise.

        Raises:
            LogError: The log is damaged.
        """
        for message in self.log.stored_messages():  # neither bytes nor pictures are needed
            self.channels.take(message, self.log)
            if take_samples is not None and message.topic == schema.SAMPLES:
                take_samples(message.t_ns, self.log.parse(message, schema.SAMPLES_SHAPE))
            elif take_estimate is not None and message.topic == schema.ESTIMATE:
                take_estimate(message.t_ns, self.log.parse(message, schema.ESTIMATE_SHAPE))
        return self

    def raw(self, device: str) -> Iterator[LogMessage]:
        """Yield what a device has sent."""
        topic = f"{schema.RAW}{device}"
        yield from (message for message in self.log.messages() if message.topic == topic)

    def pictures(self, camera: str) -> Iterator[tuple[int, CameraImage]]:
        """Yield the pictures of a camera, with the time of their exposure, else of their arrival."""
        for message in self.raw(camera):
            yield picture_time_ns(message), decode_image(message.data)

    @property
    def clock(self) -> str:
        """Name of the readings of the first wheel that make the rows of a table."""
        return "position1_rad" if "position1_rad" in self.channels else "speed1_rad_s"

    def seconds(self, t_ns: Times) -> Array:
        """Return times since the start of the log."""
        elapsed: Array = (t_ns - self.log.start_ns) / 1e9
        return elapsed

    def true_poses(self) -> TruePoses:
        """Return the known poses, see `ground_truth.true_poses`."""
        return true_poses(self.channels, self.log)

    def fixes(self) -> TruePoses | None:
        """Return the measured poses, see `ground_truth.measured_poses`."""
        return measured_poses(self.channels)

    def rolled(self, least: int) -> tuple[Times, Array] | None:
        """Return times of the first wheel's readings, (n,), and the motion of the body by its wheels, (n, 3).

        The motion is the sum of all steps ahead and to the left in m, whatever the yaw meanwhile, and the yaw
        in rad. None where a wheel has fewer readings than `least`.
        """
        kinematics = make_kinematics(self.config.rover)
        angles = [self.channels[f"position{wheel}_rad"] for wheel in range(1, kinematics.wheel_count + 1)]
        if any(len(each) < least for each in angles):
            return None
        t_ns = np.unique(angles[0].t_ns)
        rows = np.column_stack([np.interp(t_ns, each.t_ns, each.value) for each in angles])
        return t_ns, np.array([kinematics.body_motion(row) for row in rows.tolist()])

    def table(self, names: Sequence[str], *, outside: float | None = None) -> dict[str, Array]:
        """Return quantities at the times of the first wheel's readings, with `t_s` since the start.

        Single readings go into the first row at or after their time, NaN elsewhere; setpoints are held, 0
        before the first; all else is interpolated. Headings, rates and tilts are in degrees, under the names
        that CSV files of drives have.

        Args:
            names: The quantities wanted, of those that there are; of wheels the name without number.
            outside: Stands before the first and after the last reading; the end values without it.
        """
        t_ns = np.unique(self.channels[self.clock].t_ns)
        columns = {"t_s": self.seconds(t_ns)}
        for name in self.channels.names():
            if "".join(char for char in name if not char.isdigit()) not in names:
                continue
            readings = self.channels[name]
            order = np.lexsort((readings.value, readings.t_ns))
            times, values = readings.t_ns[order], readings.value[order]
            if name in DEGREES:
                values = np.degrees(values)
            if name in SINGLE:
                column = np.full(t_ns.size, np.nan)
                index = np.searchsorted(t_ns, times)
                column[index[index < t_ns.size]] = values[index < t_ns.size]
            elif name.startswith(SET_POINT):
                place = np.searchsorted(times, t_ns, side="right") - 1
                column = np.where(place >= 0, values[np.maximum(place, 0)], 0.0)
            else:
                values = np.unwrap(values) if name == "yaw_rad" else values
                column = np.interp(t_ns, times, values, left=outside, right=outside)
            columns[DEGREES.get(name, name)] = column
        return columns


def picture_time_ns(message: LogMessage) -> int:
    """Return when a picture was exposed, else when it arrived."""
    stamp_ns = capture_time_ns(message.data)
    return message.t_ns if stamp_ns is None else min(stamp_ns, message.t_ns)


def drive_name(path: Path) -> str:
    """Return the name of the drive in a log: of its folder, where the log has the name of all runs."""
    return path.parent.name if path.stem == "run" and path.parent.name else path.stem


def read_drive(path: Path, *, with_traces: bool = False) -> Drive:
    """Return the drive in a log, read to its end.

    Raises:
        LogError: The log cannot be read or is damaged.
    """
    return Drive(path, with_traces=with_traces).read()
