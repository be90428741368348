"""Read what a log of this software tells about the motors behind its wheels."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from drivers.errors import LogError
from drivers.robotino_board.codec import MAX_RAW, scales
from drivers.robotino_board.settings import RobotinoBoardSettings
from rover_hil.config import Config
from rover_hil.identify.motor_record import MotorRecord, Scale, Series, check_times
from rover_hil.identify.motor_table import cut_set_point
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader

FIELDS = ("position_rad", "speed_rad_s", "current_a", "voltage_v")
SET_POINT_TOPICS = ("/command", "/set_point")


class _Wheel:
    """Numbers of one wheel as they come, by field."""

    def __init__(self) -> None:
        self.values: dict[str, list[tuple[float, float]]] = {field: [] for field in FIELDS}
        self.current_is_signed = True

    def take(self, sample: Mapping[str, object], t_s: float) -> None:
        for field in FIELDS:
            number = sample.get(field)
            if isinstance(number, int | float) and math.isfinite(number):
                self.values[field].append((t_s, float(number)))
        if sample.get("current_is_signed") is False:
            self.current_is_signed = False

    def series(self, field: str, where: str, factor: float = 1.0) -> Series | None:
        """Return a field over time, None when there is too little of it."""
        if len(self.values[field]) < 3:
            return None
        t_s, values = np.array(self.values[field]).T
        check_times(t_s, f"{where}, {field}")
        return Series(t_s, values * factor)


def read_log(path: Path) -> list[MotorRecord]:
    """Return what a log tells about the motors of its wheel drive, one record for each wheel.

    Raises:
        LogError: The log cannot be read, or lacks wheels, currents or set-points.
    """
    log = LogReader(path)
    with restore_config(log) as config:
        pass
    wheels: dict[int, _Wheel] = {}
    set_points: list[tuple[float, ...]] = []
    for topic, record, t_s in _messages(log):
        if topic in SET_POINT_TOPICS and record.get("delivered", True) is True:
            set_points.append((t_s, *_numbers(record.get("speed_rad_s"))))
        elif topic == "/samples":
            _take_samples(record, config.roles.wheels, log.start_ns, wheels)
    if len(set_points) < 3 or not wheels:
        msg = f"{path} holds no wheel samples or no set-points: give the log of a drive"
        raise LogError(msg)
    told = np.array(set_points)
    check_times(told[:, 0], f"{path}, set-points")
    missing = sorted(set(range(told.shape[1] - 1)) - set(wheels))
    if missing:
        msg = f"{path} has set-points but no samples of motor {missing[0] + 1}: check its encoder"
        raise LogError(msg)
    return [_record(path, config, index, wheels[index], told) for index in sorted(wheels)]


def _record(path: Path, config: Config, index: int, wheel: _Wheel, told: np.ndarray) -> MotorRecord:
    device = config.devices[config.roles.wheels]
    where = f"{path} motor {index + 1}"
    gear, scale = 1.0, Scale()
    is_robotino = isinstance(device, RobotinoBoardSettings)
    if isinstance(device, RobotinoBoardSettings):
        gear = device.gear_ratio
        counts = scales(device)
        is_cut = device.board == "EA05"
        scale = Scale(
            position_rad=counts.position_rad * gear,
            speed_rad_s=counts.speed_rad_s * gear,
            current_a=counts.current_a * (4 if is_cut else 1),
            current_is_cut=is_cut,
            current_limit_a=counts.current_a * ((MAX_RAW & ~3) if is_cut else MAX_RAW),
        )
    position = wheel.series("position_rad", where, gear)
    speed = wheel.series("speed_rad_s", where, gear)
    current = wheel.series("current_a", where)
    if current is None:
        msg = f"{where}: no motor currents in the log: use a drive that reports them"
        raise LogError(msg)
    if position is None and speed is None:
        msg = f"{where}: neither positions nor speeds in the log: use a drive that reports them"
        raise LogError(msg)
    set_point = told[:, index + 1] * gear
    if scale.speed_rad_s:
        set_point = cut_set_point(set_point, scale.speed_rad_s)
    return MotorRecord(
        log=path.name,
        motor=index + 1,
        is_robotino=is_robotino,
        set_point=Series(told[:, 0], set_point),
        position=position,
        speed=speed,
        current=current,
        current_is_signed=wheel.current_is_signed,
        voltage=wheel.series("voltage_v", where),
        scale=scale,
    )


def _messages(log: LogReader) -> Iterator[tuple[str, Mapping[str, object], float]]:
    for message in log.messages():
        if message.topic in (*SET_POINT_TOPICS, "/samples"):
            record = message.json()
            if isinstance(record, dict):
                yield message.topic, record, (message.t_ns - log.start_ns) / 1e9


def _take_samples(
    record: Mapping[str, object], device: str, start_ns: int, wheels: dict[int, _Wheel]
) -> None:
    samples = record.get("WheelSample")
    for sample in samples if isinstance(samples, list) else ():
        if sample.get("device") == device:
            t_s = (int(sample["t_ns"]) - start_ns) / 1e9
            wheels.setdefault(int(sample["wheel"]), _Wheel()).take(sample, t_s)


def _numbers(value: object) -> tuple[float, ...]:
    return tuple(float(item) for item in value) if isinstance(value, list) else ()
