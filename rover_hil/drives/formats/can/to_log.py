"""Write a log of a CAN bus as a log of a rover: its frames pass through the drivers, and replay exactly."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from heapq import merge
from operator import attrgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from controllers.motion.kinematics import make_kinematics
from drivers.can.frame import ERROR_FLAG
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.device_settings import CanDeviceSettings, DriveSettings
from drivers.driver import Codec, Rejection
from drivers.errors import ConfigError, LogError
from drivers.link import Received
from drivers.samples import PoseFixSample, RateSample, Sample, WheelSample
from rover_hil.config import Config
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.drives.files.can_frames import CanFrames, timed_payloads
from rover_hil.drives.formats.can.listing import absence_of, identifier_text
from rover_hil.drives.formats.can.places import CanPlaces, drive_of_places
from rover_hil.drives.formats.drive import LONGEST_GAP_NS, START_NS, Contents, check_steering, write_drive
from rover_hil.drives.formats.table.drive_table import Row
from rover_hil.drives.formats.table.place_feed import PlaceFeed
from rover_hil.drives.formats.to_log import observing_config
from rover_hil.drives.quality.oddities import LEFT_OUT, NO_FAULT, REPAIRED, Evidence, Oddity
from rover_hil.recording.schema import TruthRecord
from rover_hil.run.composition import ReplayLinks, find_wheel_count_conflict

NOT_FOR_US = frozenset({"other_traffic", "other_node", "not_a_frame"})
"""Rejections of frames of other devices."""
REGULAR = 1.5
"""Two frames are further apart than this many usual periods where some are missing."""
FRAMES_ASKED = 20
"""So many frames of an identifier show whether a device uses it."""


@dataclass(frozen=True, slots=True)
class CanRecord:
    """One frame.

    Attributes:
        t_ns: Since the first one.
        payload: In the layout of `drivers.can.frame`.
    """

    t_ns: int
    payload: bytes


@dataclass
class _Found:
    """What the devices decode of a log."""

    identifiers: list[int] = field(default_factory=list)
    moving: set[int] = field(default_factory=set)
    steered: set[int] = field(default_factory=set)
    kinds: set[str] = field(default_factory=set)


def can_config(config: Config) -> Config:
    """Return a configuration reduced to its devices on a CAN bus: it observes.

    Raises:
        ConfigError: Its wheels are not on a CAN bus.
    """
    wheels = config.roles.wheels
    devices = [name for name, device in config.devices.items() if isinstance(device, CanDeviceSettings)]
    if wheels not in devices:
        raise ConfigError(
            f"roles.wheels is '{wheels}', which is not on a CAN bus: name a configuration whose wheels are, "
            "or give their mapping with --map"
        )
    return observing_config(config, devices)


def write_can_as_log(
    frames: CanFrames,
    config: Config,
    out: Path,
    *,
    places: CanPlaces | None = None,
    dbc_files: Sequence[Path] = (),
    with_estimate: bool = True,
) -> Iterator[Contents]:
    """Write the log `out` of a log of a CAN bus, cycle by cycle; yields what was used so far.

    Args:
        frames: The frames.
        config: As `can_config` returns it.
        out: The log; must not exist.
        places: Ground truth and positions, if any.
        dbc_files: With the signals of `places`.
        with_estimate: As for `write_drive`.

    Raises:
        LogError: The wheels of the rover are not in the log.
        ConfigError: The devices do not fit the rover.
    """
    contents = Contents()
    answers = _ask_devices(frames, config)
    _check_motion(frames, config, answers)
    used = np.flatnonzero(np.isin(frames.identifiers, np.array(answers.identifiers, np.uint32)))
    _note_rest(frames, used, answers, contents)
    start_s, end_s = float(frames.t_s[used[0]]), float(frames.t_s[used[-1]])
    rows: Sequence[Row] = ()
    if places is not None:
        drive = drive_of_places(frames, places, dbc_files, (start_s, end_s))
        rows, config = drive.rows, _with_fixes(config, has_fixes=places.fixes is not None)
        contents.oddities += drive.oddities
    sections = {row.section for row in rows} | ({"imu"} if config.roles.gyro else set())
    contents.evidence = Evidence(sections=frozenset(sections))
    sent = (CanRecord(t_ns, payload) for t_ns, payload in timed_payloads(frames, used, start_s))
    records: Iterator[CanRecord | Row] = merge(sent, rows, key=attrgetter("t_ns"))
    place_feed = PlaceFeed(None if places is None else places.fixes)

    def make_feed(links: ReplayLinks) -> Callable[[CanRecord | Row], Iterable[TruthRecord | PoseFixSample]]:
        def feed(record: CanRecord | Row) -> Iterable[TruthRecord | PoseFixSample]:
            if isinstance(record, Row):
                given = list(place_feed.records(record))
                contents.count(record.section, is_used=bool(given))
                return given
            received = Received(START_NS + record.t_ns, record.payload)
            for link in links.bytes_links.values():
                link.feed(received)
            contents.count("frames", is_used=True)
            return ()

        return feed

    origin = f"imported from {frames.path.name}"
    wall_ns = max(0, round(start_s * 1e6) * 1000)  # times before 1970 are of a clock that was not set
    for _ in write_drive(
        out, origin, config, records, make_feed, contents, with_estimate=with_estimate, wall_start_ns=wall_ns
    ):
        yield contents


def _with_fixes(config: Config, *, has_fixes: bool) -> Config:
    return config.model_copy(update={"ros2": Ros2Settings(pose_fixes=True)}) if has_fixes else config


def _ask_devices(frames: CanFrames, config: Config) -> _Found:
    """Return which identifiers the devices use, and what they decode of them."""
    bus = _Found()
    codecs = [
        device.make_codec(name)
        for name, device in config.devices.items()
        if isinstance(device, CanDeviceSettings)
    ]
    for identifier, places in frames.by_identifier().items():
        if identifier & ERROR_FLAG or _is_used(frames, places[:FRAMES_ASKED], codecs, bus):
            bus.identifiers.append(identifier)
    return bus


def _is_used(
    frames: CanFrames, places: NDArray[np.intp], codecs: Sequence[Codec[bytes]], bus: _Found
) -> bool:
    is_used = False
    for t_ns, payload in timed_payloads(frames, places, float(frames.t_s[0])):
        for codec in codecs:
            results = codec.decode(Received(START_NS + t_ns, payload))
            is_used |= not any(
                isinstance(result, Rejection) and result.reason in NOT_FOR_US for result in results
            )
            for result in results:
                if not isinstance(result, Rejection):
                    _note_kind(result, bus)
    return is_used


def _note_kind(sample: Sample, bus: _Found) -> None:
    if isinstance(sample, RateSample):
        bus.kinds.add("yaw")
    elif isinstance(sample, WheelSample):
        if sample.position_rad is not None or sample.speed_rad_s is not None:
            bus.moving.add(sample.wheel)
            bus.kinds.add("wheel")
        if sample.steering_rad is not None:
            bus.steered.add(sample.wheel)
            bus.kinds.add("steering")


def _check_motion(frames: CanFrames, config: Config, bus: _Found) -> None:
    wheels = config.devices[config.roles.wheels]
    count = wheels.make_codec(config.roles.wheels).wheel_count if isinstance(wheels, DriveSettings) else 0
    conflict = find_wheel_count_conflict(config.rover, config.roles.wheels, count)
    if conflict:
        raise ConfigError(conflict)
    if "wheel" not in bus.kinds:
        raise LogError(
            f"{frames.path}: {absence_of(bus.kinds)} under the messages of '{config.roles.wheels}': there "
            "is no drive to import; `rover-hil import can LOG --list` shows what is in the log"
        )
    kinematics = make_kinematics(config.rover)
    measured = set(range(count)) - kinematics.unmeasured
    missing = [str(wheel) for wheel in sorted(measured - bus.moving)]
    if missing:
        raise LogError(
            f"{frames.path}: no message of wheel {', '.join(missing)} is in it, so the motion is unknown: "
            "correct the mapping; `rover-hil import can LOG --list` shows what is in the log"
        )
    check_steering(kinematics, bus.steered, frames.path, "add steering to the mapping")


def _note_frames(frames: CanFrames, bus: _Found, contents: Contents) -> None:
    """Note frames that are missing in the course of an identifier, and such that lost their last bytes."""
    for identifier, places in frames.by_identifier().items():
        if identifier not in bus.identifiers or identifier & ERROR_FLAG or len(places) < FRAMES_ASKED:
            continue
        where = identifier_text(identifier)
        lengths = frames.lengths[places]
        short = int((lengths < np.bincount(lengths).argmax()).sum())
        if short:
            what = "frames shorter than the others of their identifier"
            contents.oddities.append(Oddity(what=what, where=where, count=short, done=NO_FAULT))
        gaps_s = np.diff(frames.t_s[places])
        usual_s = float(np.median(gaps_s))
        if usual_s > 0.0 and np.quantile(gaps_s, 0.9) < REGULAR * usual_s:
            missing = int(np.round(gaps_s[gaps_s > REGULAR * usual_s] / usual_s - 1.0).sum())
            if missing:
                what = "frames missing between others"
                contents.oddities.append(Oddity(what=what, where=where, count=missing, done=NO_FAULT))


def _note_rest(frames: CanFrames, places: NDArray[np.intp], bus: _Found, contents: Contents) -> None:
    """Note what of the log is not used, and its data-quality findings."""
    others = len(frames) - len(places)
    if others:
        count = len(np.unique(frames.identifiers)) - len(bus.identifiers)
        contents.notes.append(f"{others} frames of {count} other identifiers stay out of the log")
    for what, number, done in (
        ("CAN FD frames of more than 8 data bytes", frames.longer, LEFT_OUT),
        ("frames of another length than they state", frames.left_out, LEFT_OUT),
        ("lines without a frame", frames.unread, LEFT_OUT),
        ("frames behind later ones, put in order", frames.swapped, REPAIRED),
        *((what, count, REPAIRED) for what, count in frames.findings),
    ):
        if number:
            contents.oddities.append(Oddity(what=what, count=number, done=done))
    _note_frames(frames, bus, contents)
    gaps_s = np.diff(frames.t_s[places])
    holes_s = gaps_s[gaps_s * NANOSECONDS_PER_SECOND > LONGEST_GAP_NS]
    if len(holes_s):
        contents.notes.append(
            f"no frame of the rover for up to {holes_s.max():.1f} s, {len(holes_s)} times, "
            f"{holes_s.sum():.1f} s in all: the motion meanwhile is not measured"
        )
