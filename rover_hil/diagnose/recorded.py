"""What drives have recorded, what became of the measurements, and what the drives cannot show."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from controllers.motion.kinematics import make_kinematics
from rover_hil.diagnose.geometry import GeometryPart
from rover_hil.diagnose.replayed_drive import COPIED_DISTANCE, ReplayedDrive
from rover_hil.drives.quality.oddities import Evidence, unseen
from rover_hil.ready.wheels.motion_kinds import BY_HAND, KINDS

SOURCES = {
    "wheel angles": "position1_rad",
    "wheel speeds": "speed1_rad_s",
    "steering angles": "steer",
    "motor currents": "current1_a",
    "gyro": "gyro_z_rad_s",
    "heading": "heading_rad",
    "ground truth": "x_m",
}
"""Channels by their name for the user."""

OTHER_KINDS = "whether the numbers hold in other kinds of motion"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A quantity of one drive.

    Attributes:
        drive: Name of the drive.
        quantity: What it is.
        count: Number of readings.
        rate_hz: Usual rate, by the median time between readings.
        longest_gap_s: Between readings.
    """

    drive: str
    quantity: str
    count: int
    rate_hz: float
    longest_gap_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements:
    """What became of the measurements of a device in all drives.

    Attributes:
        device: Its name.
        counts: Number of measured quantities by what became of them.
        mean_normalised: Mean squared innovation over its variance, expected 1; NaN where none was compared.
        faults: Why none was used, by drive.
    """

    device: str
    counts: Mapping[str, int]
    mean_normalised: float
    faults: Mapping[str, str]

    @property
    def words(self) -> str:
        """What became of them."""
        counts = ", ".join(f"{count} {outcome}" for outcome, count in self.counts.items()) or "none compared"
        faults = "".join(f"; {drive}: {text}" for drive, text in self.faults.items())
        if math.isnan(self.mean_normalised):
            return f"{counts}{faults}"
        size = math.sqrt(self.mean_normalised)
        return f"{counts}; innovations are {size:.2g} times as large as their standard deviation{faults}"


@dataclass(frozen=True, slots=True, kw_only=True)
class NotShown:
    """What drives cannot show, and which drive would.

    Attributes:
        what: What it is.
        shown_by: The drive that would show it; "" where only `why` is known.
        why: What these drives lack.
    """

    what: str
    shown_by: str = ""
    why: str = ""

    @property
    def words(self) -> str:
        """What it is, and what is missing."""
        return f"{self.what} ({f'would show it: {self.shown_by}' if self.shown_by else f'here: {self.why}'})"


def recordings_of(each: ReplayedDrive) -> list[Recording]:
    """Return the quantities of a drive."""
    channels, rows = each.drive.channels, []
    for quantity, name in SOURCES.items():
        names = [other for other in channels.names() if other.startswith(name) and " " not in other]
        if names:
            rows.append(_recording(each.name, quantity, channels[names[0]].t_ns))
    for device, fixes in channels.fixes.items():
        t_ns = np.array([min(fix.t_capture_ns, fix.t_ns) for fix in fixes], np.int64)
        rows.append(_recording(each.name, f"positions of {device}", t_ns))
    return rows


def _recording(drive: str, quantity: str, t_ns: np.ndarray) -> Recording:
    steps_s = np.diff(np.unique(t_ns)) / 1e9
    usual_s = float(np.median(steps_s)) if steps_s.size else math.inf
    return Recording(
        drive=drive,
        quantity=quantity,
        count=len(t_ns),
        rate_hz=1.0 / usual_s,
        longest_gap_s=float(steps_s.max(initial=0.0)),
    )


def measurements_of(drives: Sequence[ReplayedDrive]) -> list[Measurements]:
    """Return what became of the measurements of each device that the estimate compares."""
    fault_of = {each.name: each.replay.position_fault for each in drives if each.replay.position_fault}
    positions = {device for each in drives for device in each.drive.channels.fixes}
    devices = dict.fromkeys([device for each in drives for device in each.replay.use] + sorted(positions))
    found = []
    for device in devices:
        uses = [each.replay.use[device] for each in drives if device in each.replay.use]
        counts: dict[str, int] = {}
        for use in uses:
            for outcome, count in use.outcomes.items():
                counts[outcome] = counts.get(outcome, 0) + count
        values = [value for use in uses for value in use.normalised]
        found.append(
            Measurements(
                device=device,
                counts=counts,
                mean_normalised=float(np.mean(values)) if values else math.nan,
                faults=fault_of if device in positions else {},
            )
        )
    return found


def not_shown(drives: Sequence[ReplayedDrive], geometry: GeometryPart) -> list[NotShown]:
    """Return what drives cannot show, what matters most first."""
    found: dict[str, str] = {}
    lacking: dict[str, str] = {}
    if all(each.truth is None and not each.copied for each in drives):
        found["the error of odometry and estimate"] = (
            "a drive with ground truth or positions: GNSS, an overhead camera, or marks measured by hand"
        )
    if any(each.copied == "yaw" for each in drives):
        lacking["the error of rotations"] = "the yaw of the ground truth is that by which the wheels turn"
    if any(each.copied == "distance" for each in drives):
        lacking["what the odometry is worth"] = COPIED_DISTANCE
    result = geometry.result
    if result is not None:
        found |= {each.number.name: each.number.shown_by for each in result.not_shown}
        kinds = {each.kind for each in drives}
        others = [kind for kind in KINDS if kind not in kinds and kind != BY_HAND]
        if others:
            found[OTHER_KINDS] = f"drives of other kinds ({', '.join(others)})"
    unseen_by = [
        unseen(make_kinematics(each.drive.config.rover), _evidence(each), _turned_rad(each))
        for each in drives
    ]
    for oddity in unseen_by[0]:
        if all(oddity in others for others in unseen_by):
            lacking[oddity.what] = oddity.where
    shown_by = [NotShown(what=what, shown_by=drive) for what, drive in found.items()]
    return [*shown_by, *(NotShown(what=what, why=why) for what, why in lacking.items())]


def _evidence(each: ReplayedDrive) -> Evidence:
    channels = each.drive.channels
    sections = {
        "imu": "gyro_z_rad_s" in channels,
        "truth": "x_m" in channels,
        "fixes": bool(channels.fixes),
    }
    return Evidence(
        sections=frozenset(name for name, is_there in sections.items() if is_there),
        has_own_turn=not channels.has_computed_wheels,
        has_both="position1_rad" in channels and "speed1_rad_s" in channels,
    )


def _turned_rad(each: ReplayedDrive) -> float:
    return float(np.ptp(each.replay.odometry[:, 2]))
