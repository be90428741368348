"""What a log says at the stops of a commissioning drive."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.drive import Drive
from rover_hil.recording import schema

LEAST_STOP_S = 1.0
SPEED_WINDOW_S = 0.25
TRIANGLE = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class Poses:
    """Poses in a commissioning drive, n cycles of it.

    Attributes:
        path: The log.
        is_virtual: The rover was simulated.
        start_ns: Its start.
        t_s: Time since its start, (n,).
        odometry: x, y, yaw by the wheels, yaw not wrapped, (n, 3).
        estimate: The same by the estimate, (n, 3).
        covariance: Of the estimate, (n, 3, 3).
        stops_s: Middle of each stop after a motion, the last one at the end, (k,).
        slip_share: Share of the driven cycles with a valid slip; NaN without a slip estimator.
    """

    path: Path
    is_virtual: bool
    start_ns: int
    t_s: Array
    odometry: Array
    estimate: Array
    covariance: Array
    stops_s: Array
    slip_share: float

    def at(self, t_s: float) -> int:
        """Return the cycle nearest to a time."""
        return int(np.argmin(np.abs(self.t_s - t_s)))

    def speed_m_s(self, t_s: float) -> float:
        """Return the speed by the wheels around a time."""
        before, after = self.at(t_s - SPEED_WINDOW_S), self.at(t_s + SPEED_WINDOW_S)
        if after <= before:
            return 0.0
        moved_m = np.hypot(*(self.odometry[after, :2] - self.odometry[before, :2]))
        return float(moved_m / (self.t_s[after] - self.t_s[before]))


def read_poses(path: Path) -> Poses:
    """Return the poses of a commissioning drive.

    Raises:
        LogError: The log is damaged, or holds no drive with a stop.
    """
    drive = Drive(path)
    log = drive.log
    rows: list[list[float]] = []
    moving: list[bool] = []
    slips: list[float] = []

    def take(t_ns: int, record: schema.EstimateRecord) -> None:
        pose, wheels = record["estimate"], record["odometry"]
        rows.append(
            [
                (t_ns - log.start_ns) / 1e9,
                *(wheels["x_m"], wheels["y_m"], wheels["yaw_rad"]),
                *(pose["x_m"], pose["y_m"], pose["yaw_rad"]),
                *pose["covariance"],
            ]
        )
        moving.append(any(record["command"]["speed_rad_s"]))
        if moving[-1] and (record.get("slip") or record.get("drift")):
            slips.append(float(_has_slip(record)))

    drive.read(take_estimate=take)
    table = np.array(rows).reshape(-1, 13)
    if not np.isfinite(table).all() or not any(moving):
        raise LogError(f"log {path} holds no drive: let `rover-hil commission` drive again")
    covariance = np.zeros((len(table), 3, 3))
    for place, (row, column) in enumerate(TRIANGLE):
        covariance[:, row, column] = covariance[:, column, row] = table[:, 7 + place]
    odometry, estimate = table[:, 1:4].copy(), table[:, 4:7].copy()
    odometry[:, 2], estimate[:, 2] = np.unwrap(odometry[:, 2]), np.unwrap(estimate[:, 2])
    return Poses(
        path=path,
        is_virtual=log.origin == "virtual",
        start_ns=log.start_ns,
        t_s=table[:, 0],
        odometry=odometry,
        estimate=estimate,
        covariance=covariance,
        stops_s=_stops(table[:, 0], np.array(moving)),
        slip_share=float(np.mean(slips)) if slips else float("nan"),
    )


def _has_slip(record: schema.EstimateRecord) -> bool:
    slip, drift = record.get("slip"), record.get("drift")
    if slip is not None:
        rover = slip.get("rover")
        return rover is not None and not rover["reason"]
    return drift is not None and not drift["reason"]


def _stops(t_s: Array, moving: Array) -> Array:
    """Return the middle of each rest of the setpoints after a motion; the last sample for the last."""
    changes = np.flatnonzero(np.diff(moving.astype(np.int8)))
    starts, middles = [place + 1 for place in changes if moving[place]], []
    for start in starts:
        later = np.flatnonzero(moving[start:])
        end = start + (int(later[0]) if later.size else len(moving) - start) - 1
        if not later.size:
            middles.append(float(t_s[end]))
        elif t_s[end] - t_s[start] >= LEAST_STOP_S:
            middles.append(0.5 * float(t_s[start] + t_s[end]))
    return np.array(middles)
