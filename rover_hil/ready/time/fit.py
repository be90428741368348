"""Offsets between devices, by what they all feel: turns.

Each device gives the yaw of the rover over time: gyros by integration, wheels by rolling, a camera that sees
ground by the turns between its frames, compasses, overhead cameras and ground truth directly. Positions
without a yaw are compared with the wheels by the whole trajectory (`rover_hil.ready.wheels`).

In blocks of a few seconds, without their constant and trend, the yaw of a device is that of the reference a
little later; the offset minimises the squares of the difference. Turns at a constant rate show no offset:
turns that begin and end do.
Standard deviations are those of a jackknife over groups of blocks. A rolling shutter shears the ground while
the rover turns: turns seem later by a share of the readout that follows from the rig. Which shutter a camera
has, its turns do not show; the readout is no longer than the time between two frames.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.rolling_shutter import rolling_shutter
from drivers.errors import LogError
from drivers.samples import UNKNOWN_YAW_STD_RAD
from rover_hil.drives.arrays import Array, Flags, Times
from rover_hil.drives.drive import Drive
from rover_hil.drives.quality.drive_paths import places_of
from rover_hil.ready.scale.record import read_ground_yaw
from rover_hil.ready.time.parameters import TIMING
from rover_hil.ready.wheels.geometry import DELAY, geometry_of, marker_numbers
from rover_hil.ready.wheels.trajectory import RecordedDrive, recorded_of
from rover_hil.ready.wheels.trajectory_fit import NORMAL, TrajectoryProblem, fit_trajectories


@dataclass(frozen=True, slots=True)
class YawTrack:
    """The yaw that a device shows.

    Attributes:
        name: What it is, in words.
        kind: `gyro`, `wheels`, `heading`, `fixes`, `truth`, `ground` or, without a yaw, `positions`.
        device: Name of the device.
        t_s: Time stamps, (n,).
        yaw_rad: Not wrapped, from any start, (n,).
        readout_share: By how much later turns are shown by a rolling shutter, over its readout.
        longest_readout_s: The time between two frames.
        recorded: The drive, of positions.
    """

    name: str
    kind: str
    device: str
    t_s: Array
    yaw_rad: Array
    readout_share: float = 0.0
    longest_readout_s: float = 0.0
    recorded: RecordedDrive | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Offset:
    """How much later a device shows a turn than the reference.

    Attributes:
        offset_s: Positive where the device is late.
        sd_s: Standard deviation.
        gain: Turns of the device over those of the reference.
        residual: Standard deviation of what is left, over that of the turns.
        blocks: Number of blocks that were used.
        search_s, cost: Offsets that were tried, and the share of the turns that each leaves, for the picture.
        problem: Why the offset must not be used; empty where it may.
    """

    track: YawTrack
    offset_s: float
    sd_s: float
    gain: float
    residual: float
    blocks: int
    search_s: Array
    cost: Array
    problem: str


def read_tracks(path: Path) -> list[YawTrack]:
    """Return the yaw by every device of a log; the first is `roles.gyro`, else another gyro, else the wheels.

    Raises:
        LogError: The log is damaged, or fewer than two devices show turns.
    """
    return tracks_of(Drive(path, with_devices=True).read())


def tracks_of(drive: Drive) -> list[YawTrack]:
    """Return the same of a drive that is read with its devices.

    Raises:
        LogError: Fewer than two devices show turns.
    """
    config, rows = drive.config, drive.channels
    gyros = sorted(rows.of_devices("gyro_z_rad_s").items(), key=lambda each: each[0] != config.roles.gyro)
    tracks = [_track(drive, "gyro", device, rate.t_ns, rate.value, is_rate=True) for device, rate in gyros]
    rolled = drive.rolled(TIMING.least_readings + 1)
    if rolled is not None:
        tracks.append(_track(drive, "wheels", config.roles.wheels, rolled[0], rolled[1][:, 2]))
    for source, heading in rows.of_devices("heading_rad").items():
        tracks.append(_track(drive, "heading", source.rpartition(" ")[0], heading.t_ns, heading.value))
    for device, fix in rows.of_devices("fix_yaw_rad").items():
        if all(each.yaw_std_rad < UNKNOWN_YAW_STD_RAD for each in rows.fixes.get(device, ())):
            tracks.append(_track(drive, "fixes", device, fix.t_ns, fix.value))
    truth = rows["yaw_rad"]
    if len(truth):
        tracks.append(_track(drive, "truth", "truth", truth.t_ns, truth.value))
    ground = read_ground_yaw(drive)
    if ground is not None and config.roles.camera is not None and config.ground_motion is not None:
        shutter = rolling_shutter(GroundPatch(config.ground_motion.rig.geometry()))
        tracks.append(
            replace(
                _track(drive, "ground", config.roles.camera, *ground),
                readout_share=shutter.turn_delay,
                longest_readout_s=float(np.diff(ground[0]).min()) / 1e9 if len(ground[0]) > 1 else 0.0,
            )
        )
    tracks = [track for track in tracks if len(track.t_s) > TIMING.least_readings]
    if rolled is not None:
        tracks += _positions(drive)
    if len(tracks) < 2:
        raise LogError(
            f"log {drive.log.path}: fewer than two devices show turns: gyro, wheels, compass, overhead "
            "camera, ground truth or positions"
        )
    return tracks


def find_offsets(tracks: Sequence[YawTrack]) -> list[Offset]:
    """Return the offset of every device against the first one."""
    reference, *others = tracks
    offsets: list[Offset] = []
    for track in others:
        if track.recorded is None:
            offsets.append(_find(reference, track))
        else:
            wheels = next((each for each in offsets if each.track.kind == "wheels"), None)
            offsets.append(_by_trajectory(track, track.recorded, wheels))
    return offsets


def _positions(drive: Drive) -> list[YawTrack]:
    """Return ground truth or positions that have no yaw."""
    known = next(places_of(drive.channels), None)
    if known is None or known[1].yaw_rad is not None:
        return []
    try:
        recorded = recorded_of(drive)
    except LogError:  # too few of them
        return []
    name, nothing = known[0], np.zeros(0)
    return [YawTrack(name, "positions", name, nothing, nothing, recorded=recorded)]


def _by_trajectory(track: YawTrack, recorded: RecordedDrive, wheels: Offset | None) -> Offset:
    """Return the offset of positions: that against the wheels, and that of the wheels."""
    geometry = geometry_of(recorded.rover)
    numbers = (*geometry.numbers, *marker_numbers(recorded.rover, has_yaw=False))
    problem = TrajectoryProblem([recorded], geometry, numbers)
    fit = fit_trajectories(problem)
    (delay,) = (each for each in fit.estimates if each.number.name == DELAY)
    sd_s = delay.half_width / NORMAL
    wheels_s = 0.0 if wheels is None or wheels.problem else wheels.offset_s
    wheels_sd_s = 0.0 if wheels is None or wheels.problem else wheels.sd_s
    nothing = np.zeros(0)
    return Offset(
        track=track,
        offset_s=delay.value + wheels_s,
        sd_s=math.hypot(sd_s, wheels_sd_s, TIMING.least_sd_s),
        gain=1.0,
        residual=0.0,
        blocks=len(problem.segments),
        search_s=nothing,
        cost=nothing,
        problem=_problem(delay.value, sd_s, 0.0),
    )


def _track(
    drive: Drive, kind: str, device: str, t_ns: Times, values: Array, *, is_rate: bool = False
) -> YawTrack:
    times, keep = np.unique(t_ns, return_index=True)
    values = values[keep]
    finite = np.isfinite(values)
    t_s, values = drive.seconds(times[finite]), values[finite]
    if is_rate and len(t_s):
        parts = 0.5 * np.diff(t_s) * (values[1:] + values[:-1])
        values = np.concatenate(([0.0], np.cumsum(parts)))
    words = {
        "gyro": "gyro",
        "wheels": "wheels",
        "heading": "compass",
        "fixes": "overhead camera",
        "ground": "ground camera",
    }
    name = "ground truth" if kind == "truth" else f"{words[kind]} '{device}'"
    return YawTrack(name, kind, device, t_s, np.unwrap(values))


def _find(reference: YawTrack, track: YawTrack) -> Offset:
    blocks = _blocks(reference, track)
    search_s = np.arange(-TIMING.greatest_offset_s, TIMING.greatest_offset_s + 1e-9, TIMING.step_s)
    if len(blocks) < TIMING.least_blocks:
        problem = (
            f"the rover turned back and forth in {len(blocks)} blocks of {TIMING.block_s:g} s, "
            f"{TIMING.least_blocks} are needed: record turns that begin and end"
        )
        nothing = np.zeros(0)
        return Offset(
            track=track, offset_s=math.nan, sd_s=math.nan, gain=math.nan, residual=math.nan,
            blocks=len(blocks), search_s=nothing, cost=nothing, problem=problem,
        )  # fmt: skip
    sums = np.array(
        [[_sums(reference, track, block, each) for each in search_s.tolist()] for block in blocks]
    )
    cost = _cost(sums.sum(axis=0))
    best = _refined(reference, track, blocks, float(search_s[np.argmin(cost)]))
    groups = [blocks[first :: TIMING.groups] for first in range(min(TIMING.groups, len(blocks)))]
    others = np.array(
        [_refined(reference, track, [each for each in blocks if each not in group], best) for group in groups]
    )
    sd_s = math.sqrt((len(others) - 1) * float(np.mean((others - others.mean()) ** 2)))
    total = np.sum([_sums(reference, track, block, best) for block in blocks], axis=0)
    residual = math.sqrt(max(0.0, float(_cost(total[None])[0])))
    return Offset(
        track=track,
        offset_s=best,
        sd_s=math.hypot(sd_s, TIMING.least_sd_s),
        gain=float(total[1] / total[0]),
        residual=residual,
        blocks=len(blocks),
        search_s=search_s,
        cost=cost,
        problem=_problem(best, sd_s, residual),
    )


def _problem(offset_s: float, sd_s: float, residual: float) -> str:
    if residual > TIMING.greatest_residual:
        return f"{100 * residual:.0f} % of its turns are not those of the reference"
    if abs(offset_s) > TIMING.greatest_offset_s - 2 * TIMING.step_s:
        return f"the offset is larger than {TIMING.greatest_offset_s:g} s"
    if sd_s > TIMING.greatest_sd_s:
        return f"the offset is uncertain by {sd_s:.2f} s: record more turns that begin and end"
    return ""


def _blocks(reference: YawTrack, track: YawTrack) -> list[float]:
    """Return the starts of the blocks in which both devices show turns that are not at a constant rate."""
    margin_s = TIMING.greatest_offset_s
    first = max(reference.t_s[0], track.t_s[0]) + margin_s
    last = min(reference.t_s[-1], track.t_s[-1]) - margin_s - TIMING.block_s
    blocks = []
    for start_s in np.arange(first, last, TIMING.block_s).tolist():
        inside = _inside(track.t_s, start_s)
        times = track.t_s[inside]
        if len(times) < TIMING.least_readings or np.diff(times).max() > TIMING.longest_gap_s:
            continue
        near = (reference.t_s >= start_s - margin_s) & (reference.t_s < start_s + TIMING.block_s + margin_s)
        if near.sum() < TIMING.least_readings or np.diff(reference.t_s[near]).max() > TIMING.longest_gap_s:
            continue
        turned = _rest(times, np.interp(times, reference.t_s, reference.yaw_rad))
        if float(np.std(turned)) >= TIMING.least_turn_rad:
            blocks.append(start_s)
    return blocks


def _inside(t_s: Array, start_s: float) -> Flags:
    is_in_block: Flags = (t_s >= start_s) & (t_s < start_s + TIMING.block_s)
    return is_in_block


def _rest(t_s: Array, values: Array) -> Array:
    """Return values without their constant and trend."""
    since_s = t_s - t_s.mean()
    level = values - values.mean()
    residuals: Array = level - float(since_s @ level) / float(since_s @ since_s) * since_s
    return residuals


def _sums(reference: YawTrack, track: YawTrack, start_s: float, offset_s: float) -> Array:
    """Return the sums xx, xy, yy of the reference `offset_s` earlier and the device in a block."""
    inside = _inside(track.t_s, start_s)
    t_s = track.t_s[inside]
    x = _rest(t_s, np.interp(t_s - offset_s, reference.t_s, reference.yaw_rad))
    y = _rest(t_s, track.yaw_rad[inside])
    return np.array([x @ x, x @ y, y @ y])


def _cost(sums: Array) -> Array:
    """Return the share of the squares that the best gain leaves, for rows of sums."""
    xx, xy, yy = np.maximum(sums[:, 0], 1e-30), sums[:, 1], np.maximum(sums[:, 2], 1e-30)
    share: Array = np.where(xy > 0.0, 1.0 - xy**2 / (xx * yy), 1.0)
    return share


def _refined(reference: YawTrack, track: YawTrack, blocks: Sequence[float], near_s: float) -> float:
    def cost(offset_s: float) -> float:
        total = np.sum([_sums(reference, track, block, offset_s) for block in blocks], axis=0)
        return float(_cost(total[None])[0])

    bounds = (near_s - 2 * TIMING.step_s, near_s + 2 * TIMING.step_s)
    return float(minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-4}).x)
