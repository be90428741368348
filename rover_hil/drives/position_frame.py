"""The frame of positions, estimated over a whole drive, and the poses of the drive in it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controllers.estimation.positions.alignment import PathAlignment
from drivers.samples import PoseFixSample
from rover_hil.drives.arrays import Array
from rover_hil.drives.drive import Drive
from rover_hil.recording.schema import EstimateRecord

COLUMNS = ("t_s", "x_m", "y_m", "yaw_rad")


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionFrame:
    """How the frame of positions lies, and the estimated poses in it.

    Attributes:
        device: That measured the positions.
        count: Of them.
        turned_rad: Yaw of the local frame in that of the positions.
        turned_sd_rad: Its standard deviation by the noise of the positions.
        origin_m: Where the origin of the local frame lies in that of the positions, x as real part.
        rms_m: What positions and estimate differ by, root mean square.
        poses: `COLUMNS`, a row for each new estimate, at the time that it is of.
    """

    device: str
    count: int
    turned_rad: float
    turned_sd_rad: float
    origin_m: complex
    rms_m: float
    poses: Array

    def place(self, poses: Array) -> Array:
        """Return poses of the local frame in that of the positions: `COLUMNS`, times as they are."""
        return _placed(poses, self.origin_m, self.turned_rad)


def _placed(poses: Array, origin_m: complex, turned_rad: float) -> Array:
    places_m = origin_m + (poses[:, 1] + 1j * poses[:, 2]) * np.exp(1j * turned_rad)
    return np.column_stack((poses[:, 0], places_m.real, places_m.imag, poses[:, 3] + turned_rad))


def position_frame(path: Path) -> PositionFrame | None:
    """Return the frame of the positions in a log with an estimate; None where none has a known direction.

    Positions with a yaw are used without it: their spread over a drive shows the direction as well.

    Raises:
        LogError: The log cannot be read or is damaged.
    """
    rows: list[tuple[float, float, float, float]] = []

    def take(_: int, record: EstimateRecord) -> None:
        pose = record["estimate"]
        if not rows or pose["t_ns"] > rows[-1][0]:
            rows.append((pose["t_ns"], pose["x_m"], pose["y_m"], pose["yaw_rad"]))

    drive = Drive(path)
    if not drive.config.fix_sources:
        return None
    drive.read(take_estimate=take)
    table = np.array(rows, np.float64).reshape(-1, 4)
    frames = [
        frame
        for device, fixes in drive.channels.fixes.items()
        if len(table) and (frame := _frame(device, fixes, table, drive.log.start_ns)) is not None
    ]
    return max(frames, key=lambda each: each.count, default=None)


def _frame(device: str, fixes: list[PoseFixSample], table: Array, start_ns: int) -> PositionFrame | None:
    t_ns, x_m, y_m, yaw_rad = table[:, 0], table[:, 1], table[:, 2], np.unwrap(table[:, 3])
    used = [
        fix
        for fix in fixes
        if t_ns[0] <= min(fix.t_capture_ns, fix.t_ns) <= t_ns[-1]
        and np.isfinite(fix.x_m + fix.y_m)
        and fix.position_std_m > 0.0
    ]
    alignment, then = PathAlignment(), []
    for fix in used:
        at_ns = min(fix.t_capture_ns, fix.t_ns)
        place = complex(np.interp(at_ns, t_ns, x_m), np.interp(at_ns, t_ns, y_m))
        arm = complex(fix.arm_x_m, fix.arm_y_m) * np.exp(1j * np.interp(at_ns, t_ns, yaw_rad))
        then.append(place + arm)
        alignment.take(complex(fix.x_m, fix.y_m), place + arm, fix.position_std_m)
    if not used or not alignment.is_known:
        return None
    errors = np.array([complex(fix.x_m, fix.y_m) for fix in used]) - (
        alignment.origin_m + np.array(then) * np.exp(1j * alignment.turned_rad)
    )
    local = np.column_stack(((t_ns - start_ns) / 1e9, x_m, y_m, yaw_rad))
    return PositionFrame(
        device=device,
        count=len(used),
        turned_rad=alignment.turned_rad,
        turned_sd_rad=alignment.turned_sd_rad,
        origin_m=alignment.origin_m,
        rms_m=float(np.sqrt(np.mean(np.abs(errors) ** 2))),
        poses=_placed(local, alignment.origin_m, alignment.turned_rad),
    )
