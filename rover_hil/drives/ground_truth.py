"""Known poses of a recorded drive: the simulated pose, measured poses, or marks by hand."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.errors import LogError
from drivers.samples import PoseFixSample
from rover_hil.drives.arrays import Array, Times
from rover_hil.drives.channels import POSE, Channels
from rover_hil.drives.marks import marks_beside, read_marks
from rover_hil.recording.reader import LogReader


@dataclass(frozen=True, slots=True, kw_only=True)
class TruePoses:
    """Known poses of the rover, n of them.

    Attributes:
        source: What measured them, in words.
        t_ns: Host monotonic time, (n,) as everything else.
        yaw_rad: Unwrapped.
        position_sd_m: Standard deviation of x and of y; 0 where the pose is exact.
        yaw_sd_rad: The same of the yaw.
        arm_m: Where on the rover the places are that have no yaw, ahead as real part.
    """

    source: str
    t_ns: Times
    x_m: Array
    y_m: Array
    yaw_rad: Array
    position_sd_m: Array
    yaw_sd_rad: Array
    arm_m: complex = 0j

    @property
    def t_s(self) -> Array:
        """The times in s."""
        t_s: Array = self.t_ns / 1e9
        return t_s

    @property
    def is_exact(self) -> bool:
        """Whether the poses have no noise."""
        return not (self.position_sd_m.any() or self.yaw_sd_rad.any())


def exact_poses(source: str, t_ns: Times, x_m: Array, y_m: Array, yaw_rad: Array) -> TruePoses:
    """Return poses without noise; see `TruePoses`."""
    exact, yaw_rad = np.zeros(len(t_ns)), np.unwrap(yaw_rad)
    return TruePoses(
        source=source, t_ns=t_ns, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, position_sd_m=exact, yaw_sd_rad=exact
    )


def true_poses(channels: Channels, log: LogReader) -> TruePoses:
    """Return the poses on `/truth`, else those of the camera in `roles.fixes` that gave most fixes.

    Ground truth without yaw is none of poses.

    Without both, the marks measured by hand in the file beside the log (`rover_hil.drives.marks`), those that
    have a yaw. A fix counts from when its picture was taken; one that is not newer than the last is left out.

    Raises:
        LogError: There is none of them, or the ground truth has no yaw.
    """
    if POSE[0] in channels and POSE[2] not in channels:
        raise LogError(f"log {log.path}: its ground truth has positions, but no yaw, which is needed here")
    if POSE[0] in channels:
        x, y, yaw = (channels[name] for name in POSE)
        source = "simulated pose" if log.origin == "virtual" else f"pose on /truth, {log.origin}"
        return exact_poses(source, x.t_ns, x.value, y.value, yaw.value)
    fixes = measured_poses(channels) or _marks_of(log)
    if fixes is None:
        raise LogError(
            f"log {log.path} holds no true pose, neither on /truth nor as pose fixes of a device in "
            "roles.fixes: record one with an overhead camera"
        )
    return fixes


def measured_poses(channels: Channels) -> TruePoses | None:
    """Return the poses of the camera in `roles.fixes` that gave most fixes; None without one."""
    device = max(channels.fixes, key=lambda name: len(channels.fixes[name]), default=None)
    return None if device is None else _poses_of(device, channels.fixes[device])


def _poses_of(device: str, fixes: Sequence[PoseFixSample]) -> TruePoses:
    columns = ("x_m", "y_m", "yaw_rad", "position_std_m", "yaw_std_rad")
    t_ns = np.array([min(fix.t_capture_ns, fix.t_ns) for fix in fixes], np.int64)
    table = np.array([[getattr(fix, name) for name in columns] for fix in fixes])
    newest_before = np.concatenate(([-1], np.maximum.accumulate(t_ns)[:-1]))
    use = (t_ns > newest_before) & np.isfinite(table).all(axis=1)
    x_m, y_m, yaw_rad, position_sd_m, yaw_sd_rad = table[use].T
    return TruePoses(
        source=f"pose fixes of '{device}'",
        t_ns=t_ns[use],
        x_m=x_m,
        y_m=y_m,
        yaw_rad=np.unwrap(yaw_rad),
        position_sd_m=position_sd_m,
        yaw_sd_rad=yaw_sd_rad,
        arm_m=complex(fixes[0].arm_x_m, fixes[0].arm_y_m),
    )


def _marks_of(log: LogReader) -> TruePoses | None:
    path = marks_beside(log.path)
    if path is None:
        return None
    marks = read_marks(path)
    use = np.isfinite(marks.yaw_deg)
    if not use.any():
        return None
    return TruePoses(
        source=f"marks measured by hand in {path.name}",
        t_ns=log.start_ns + np.round(1e9 * marks.t_s[use]).astype(np.int64),
        x_m=marks.x_m[use],
        y_m=marks.y_m[use],
        yaw_rad=np.unwrap(np.radians(marks.yaw_deg[use])),
        position_sd_m=marks.sigma_m[use],
        yaw_sd_rad=marks.yaw_sd_rad[use],
    )
