"""Read our own logs for identification: wheel positions, currents and the true pose."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from controllers.settings import OmniRoverSettings
from drivers.errors import LogError
from drivers.samples import RateSample, WheelSample
from rover_hil.config import RoleSettings
from rover_hil.identify.run_data import WHEELS, Array, Flags, MeasuredRun
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogMessage, LogReader

LONGEST_GAP_S = 0.15
"""Between readings of a wheel further away than this nothing is made up."""


class _Samples(BaseModel):
    wheels: list[WheelSample] = Field(default=[], alias="WheelSample")
    rates: list[RateSample] = Field(default=[], alias="RateSample")


class _Truth(BaseModel):
    t_ns: int
    x_m: float
    y_m: float
    yaw_rad: float
    is_new: bool = True


class _SetPoint(BaseModel):
    speed_rad_s: tuple[float, ...]
    delivered: bool = True


def read_log_run(path: Path, surface: str) -> MeasuredRun:
    """Return the run in the log `path`.

    Raises:
        LogError: The log is damaged, is of another kind of rover, or lacks wheels, currents or the true pose.
    """
    log = LogReader(path)
    with restore_config(log) as config:
        rover, roles = config.rover, config.roles
    if not isinstance(rover, OmniRoverSettings):
        msg = f"{path} is of a {rover.kinematics} rover: slip maps need three omnidirectional wheels"
        raise LogError(msg)
    rows: defaultdict[str, list[tuple[float, ...]]] = defaultdict(list)
    for message in log.messages():
        try:
            _take(message, roles, rows)
        except ValidationError as error:
            msg = f"{path} is damaged: {message.topic} at {message.t_ns} ns: {error.errors()[0]['msg']}"
            raise LogError(msg) from error
    return _assemble(path, surface, rows, rover)


def _take(message: LogMessage, roles: RoleSettings, rows: defaultdict[str, list[tuple[float, ...]]]) -> None:
    match message.topic:
        case "/samples":
            samples = _Samples.model_validate_json(message.data)
            rows["gyro"] += [
                (rate.t_ns / 1e9, rate.rate_z_rad_s) for rate in samples.rates if rate.device == roles.gyro
            ]
            for wheel in samples.wheels:
                if wheel.device == roles.wheels:
                    rows[f"signed {wheel.wheel}"] = [(float(wheel.current_is_signed),)]
                    for kind, value in (("position", wheel.position_rad), ("current", wheel.current_a)):
                        if value is not None:
                            rows[f"{kind} {wheel.wheel}"].append((wheel.t_ns / 1e9, value))
        case "/truth":
            truth = _Truth.model_validate_json(message.data)
            if truth.is_new:
                rows["truth"].append((truth.t_ns / 1e9, truth.x_m, truth.y_m, truth.yaw_rad))
        case "/command" | "/set_point":
            set_point = _SetPoint.model_validate_json(message.data)
            if set_point.delivered:
                rows["set_point"].append((message.t_ns / 1e9, *set_point.speed_rad_s))


def _assemble(
    path: Path, surface: str, rows: dict[str, list[tuple[float, ...]]], rover: OmniRoverSettings
) -> MeasuredRun:
    for wheel in range(WHEELS):
        for kind, word in (("position", "positions"), ("current", "currents")):
            if not rows.get(f"{kind} {wheel}"):
                msg = f"log {path} holds no {word} of wheel {wheel}: slip cannot be told from it"
                raise LogError(msg)
    if not rows.get("truth"):
        msg = f"log {path} holds no true pose on /truth: record one with an overhead camera"
        raise LogError(msg)
    position = [np.array(rows[f"position {wheel}"]) for wheel in range(WHEELS)]
    current = [np.array(rows[f"current {wheel}"]) for wheel in range(WHEELS)]
    truth, gyro = np.array(rows["truth"]), np.array(rows.get("gyro") or np.empty((0, 2)))
    _check_numbers(path, (*position, *current, truth, gyro))
    _check_clock(path, (*position, *current, truth))
    t_s = position[0][:, 0]
    _check_positions(path, position, t_s)
    origin_s = float(t_s[0])
    return MeasuredRun(
        path=path,
        surface=surface,
        t_s=t_s - origin_s,
        position_rad=np.column_stack([np.interp(t_s, table[:, 0], table[:, 1]) for table in position]),
        current_a=np.column_stack(
            [np.where(_is_heard(table, t_s), np.interp(t_s, *table.T), np.nan) for table in current]
        ),
        current_is_signed=rows["signed 0"][0][0] > 0.0,
        set_speed_rad_s=_held(rows.get("set_point", []), t_s),
        camera_t_s=truth[:, 0] - origin_s,
        camera=np.column_stack((truth[:, 1:3], np.unwrap(truth[:, 3]))),
        camera_in_pixels=False,
        rover=rover,
        gyro=gyro - (origin_s, 0.0),
    )


def _check_numbers(path: Path, tables: Sequence[Array]) -> None:
    if not all(np.isfinite(table).all() for table in tables):
        msg = f"log {path} holds samples or true poses that are no numbers: it is damaged, record it again"
        raise LogError(msg)


def _check_clock(path: Path, tables: Sequence[Array]) -> None:
    if any((np.diff(table[:, 0]) <= 0.0).any() for table in tables):
        msg = f"log {path}: its clock goes backwards or stands: the run cannot be used"
        raise LogError(msg)


def _check_positions(path: Path, tables: Sequence[Array], t_s: Array) -> None:
    for wheel, table in enumerate(tables):
        silent = ~_is_heard(table, t_s)
        if silent.any():
            begins_s = float(t_s[np.argmax(silent)] - t_s[0])
            msg = (
                f"log {path}: wheel {wheel} gives no position {begins_s:.2f} s after wheel 0's first, while "
                "others do: check its encoder, the run cannot be used"
            )
            raise LogError(msg)


def _is_heard(table: Array, t_s: Array) -> Flags:
    """Tell the times that have a reading of `table` within `LONGEST_GAP_S`."""
    after = np.searchsorted(table[:, 0], t_s).clip(0, len(table) - 1)
    before = (after - 1).clip(0)
    away_s = np.minimum(np.abs(table[after, 0] - t_s), np.abs(table[before, 0] - t_s))
    heard: Flags = away_s <= LONGEST_GAP_S
    return heard


def _held(set_points: list[tuple[float, ...]], t_s: Array) -> Array:
    """Return the newest set-points at each time; NaN before the first."""
    table = np.array([(0.0, *[np.nan] * WHEELS), *set_points])
    held: Array = table[np.searchsorted(table[:, 0], t_s, side="right") - 1, 1:]
    return held
