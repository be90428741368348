"""A procedure that drives stops when a device that it needs is lost, and leaves no result behind."""

import re
from pathlib import Path

import pytest

from rover_hil.config import load_config, read_config_text
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import COMMAND, SET_POINT_SHAPE
from tests.rover_hil.command import Command, assert_one_sentence

LOST_S = 6.0
"""After the start of the simulation; every procedure moves by then."""
REACTION_S = 0.15
"""In addition to the age limit of the device."""
ROVERS = {"rover.toml": "robotino", "compass.toml": "el-dorado", "camera.toml": "robotino-camera"}
PROCEDURES = {
    "calibrate imu rover.toml --out o.toml": ("board", "imu"),
    "calibrate mounting rover.toml --turns 2 --out o.toml": ("board", "imu"),
    "calibrate mounting compass.toml --turns 2 --out o.toml": ("wheels", "imu", "compass"),
    "calibrate compass compass.toml --turns 2 --out o.toml": ("wheels", "imu", "compass"),
    "calibrate motors compass.toml --out o.toml": ("wheels", "imu", "compass"),
    "calibrate wheels rover.toml --out o.toml": ("board", "imu"),
    "calibrate scale camera.toml --out o.toml": ("board", "imu", "camera"),
    "commission rover.toml --out runs": ("board", "imu"),
    "commission camera.toml --out runs": ("board", "imu", "camera"),
}
OFTEN = {
    "calibrate imu rover.toml --out o.toml": ("board", "imu"),
    "calibrate mounting compass.toml --turns 2 --out o.toml": ("compass",),
    "calibrate compass compass.toml --turns 2 --out o.toml": ("imu",),
    "calibrate motors compass.toml --out o.toml": ("wheels",),
    "calibrate wheels rover.toml --out o.toml": ("imu",),
    "calibrate scale camera.toml --out o.toml": ("camera",),
    "commission rover.toml --out runs": ("board",),
    "commission camera.toml --out runs": ("camera",),
}
"""Each procedure once, and each kind of device."""
CASES = [
    (line, device) if device in OFTEN.get(line, ()) else pytest.param(line, device, marks=pytest.mark.nightly)
    for line, devices in PROCEDURES.items()
    for device in devices
]


def write_with_loss(name: str, device: str) -> None:
    """Write a configuration whose simulated device is unplugged for good."""
    text = re.sub(r"(?m)^#:schema.*\n", "", read_config_text(ROVERS[name]))
    fault = f'[[simulation.faults]]\ntype = "unplug"\ndevice = "{device}"\n'
    Path(name).write_text(f"{text}\n{fault}start_s = {LOST_S}\nduration_s = 1e5\n", "utf-8")


def last_motion_s(log: Path) -> float:
    """Return when the last setpoint was sent that is not zero, after the start of the log."""
    reader = LogReader(log)
    sent = [
        (message.t_ns, reader.parse(message, SET_POINT_SHAPE)["speed_rad_s"])
        for message in reader.messages()
        if message.topic == COMMAND
    ]
    times = [t_ns for t_ns, speeds in sent if any(speeds)]
    return (max(times) - reader.start_ns) / 1e9


@pytest.mark.slow
@pytest.mark.parametrize(("line", "device"), CASES)
@pytest.mark.usefixtures("unrendered")
def test_every_procedure_stops_when_a_device_that_it_needs_is_unplugged(
    command: Command, line: str, device: str
) -> None:
    name = next(word for word in line.split() if word in ROVERS)
    write_with_loss(name, device)
    before = set(Path().rglob("*"))
    assert command(*line.split(), "--virtual") == 1
    assert_one_sentence(command.error, f"{device}: ", "link down (unplugged)", "stays at rest")
    written = {path for path in Path().rglob("*") if path.is_file()} - before
    assert {path.suffix for path in written} == {".mcap"}
    (log,) = written
    assert 1.0 < last_motion_s(log) < LOST_S + load_config(name).devices[device].max_age_s + REACTION_S
