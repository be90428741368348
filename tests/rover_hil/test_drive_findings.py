"""Wrong sensors in recorded drives: they are named, or the region contains the truth; sound ones are not."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.cases import first_often
from tests.rover_hil.command import Command
from tests.rover_hil.field_bags import ARC, CORNER, JOINTS, Bag, Segment, States, write_bag
from tests.rover_hil.test_field_bags import CORNER_END, FIELD_BAGS, end_of, field_reports, import_it

SPOT: tuple[Segment, ...] = ((0.0, 0.0, 1.0), (0.0, 0.6, 5.0), (0.0, -0.6, 8.0), (0.0, 0.0, 1.0))
LINE: tuple[Segment, ...] = ((0.0, 0.0, 1.0), (0.3, 0.0, 8.0), (0.0, 0.0, 1.0))
DRIVES = {"corner": CORNER, "arc": ARC, "spot": SPOT, "line": LINE}
Wheels = Callable[[float, list[float], list[float]], list[States]]


def scaled(factor: float) -> Callable[[int, float], float]:
    return lambda _, rate: factor * rate


def zeros(every: int) -> Callable[[int, float], float]:
    return lambda number, rate: 0.0 if number % every == 0 else rate


def wheels(left: float, right: float) -> Wheels:
    def change(_: float, angles: list[float], speeds: list[float]) -> list[States]:
        factors = (left, right)
        return [
            States(
                list(JOINTS),
                [factor * angle for factor, angle in zip(factors, angles, strict=True)],
                [factor * speed for factor, speed in zip(factors, speeds, strict=True)],
            )
        ]

    return change


def exchanged(_: float, angles: list[float], speeds: list[float]) -> list[States]:
    return [States(list(JOINTS), angles[::-1], speeds[::-1])]


FAULTS = {
    "sign": Bag(gyro=scaled(-1.0)),
    "deg/s": Bag(gyro=scaled(math.degrees(1.0))),
    "scaled": Bag(gyro=scaled(0.12)),
    "doubled": Bag(gyro=scaled(2.0)),
    "zeros": Bag(gyro=zeros(2)),
    "no signal": Bag(gyro=lambda _, __: 0.0),
    "left reversed": Bag(change=wheels(-1.0, 1.0)),
    "right reversed": Bag(change=wheels(1.0, -1.0)),
    "exchanged": Bag(change=exchanged),
}


def findings_of(command: Command) -> list[dict[str, object]]:
    assert command("replay", "drive.mcap", "--json") == 0
    found = json.loads(command.out)["findings"]
    assert isinstance(found, list)
    return found


@pytest.mark.parametrize("drive", first_often(DRIVES))
@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_sensor_is_named_or_the_region_contains_the_truth(
    command: Command, tmp_path: Path, drive: str, fault: str
) -> None:
    track = write_bag(tmp_path / "bag", replace(FAULTS[fault], segments=DRIVES[drive]))
    assert import_it(command, tmp_path / "bag") == 0, command.error
    told = command.out
    found = findings_of(command)
    assert found or end_of(Path("drive.mcap")).contains(track.end)
    for finding in found:
        assert str(finding["text"]) in told


@pytest.mark.parametrize("drive", first_often(DRIVES))
@pytest.mark.parametrize("imu", ["gyro", "shaking", "none"])
def test_sound_drives_have_no_finding_and_the_right_pose(
    command: Command, tmp_path: Path, drive: str, imu: str
) -> None:
    track = write_bag(tmp_path / "bag", Bag(segments=DRIVES[drive], imu=imu))
    assert import_it(command, tmp_path / "bag", imu=imu != "none") == 0, command.error
    assert findings_of(command) == []
    end = end_of(Path("drive.mcap"))
    assert end.is_right(track.end)
    assert math.sqrt(end.covariance[0] + end.covariance[3]) < 0.9  # 0.3 of the way: the ground is unknown


@pytest.mark.usefixtures("unrendered")
def test_opposite_rotations_are_reported_and_the_region_contains_both_ends(
    command: Command, tmp_path: Path
) -> None:
    """An exchange of the wheels and a wrong sign of the gyro give the same drive for the estimate."""
    write_bag(tmp_path / "bag", Bag(gyro=scaled(-1.0)))
    assert import_it(command, tmp_path / "bag") == 0, command.error
    assert "finding in the whole drive: the gyro has the opposite sign" in command.out
    assert "wheels and ground truth agree" in command.out
    (cause, *_) = findings_of(command)
    assert "wheels +1.571 rad, gyro -1.5" in json.dumps(cause["consequences"])
    end = end_of(Path("drive.mcap"))
    assert end.contains(CORNER_END)
    assert end.contains((CORNER_END[0], -CORNER_END[1], -CORNER_END[2]))
    assert command("replay", "drive.mcap", "--out", "report") == 0
    summary = json.loads(Path("report/summary.json").read_text("utf-8"))
    assert "turn" in {finding["name"] for finding in summary["findings"][0]["consequences"]}
    assert "the gyro has the opposite sign" in Path("report/report.html").read_text("utf-8")


class DeadEncoder:
    """The left encoder does not count for ten seconds; then it counts on, or knows the whole angle again."""

    def __init__(self, *, counts_on: bool) -> None:
        self._counts_on = counts_on
        self._held_rad = self._true_rad = 0.0

    def __call__(self, t_s: float, angles: list[float], speeds: list[float]) -> list[States]:
        left_rad, right_rad = angles
        if t_s < 6.0:
            self._held_rad = left_rad
        if t_s < 16.0:
            self._true_rad = left_rad
        if 6.0 <= t_s < 16.0:
            return [States(list(JOINTS), [self._held_rad, right_rad], [0.0, speeds[1]])]
        if t_s >= 16.0 and self._counts_on:
            left_rad += self._held_rad - self._true_rad
        return [States(list(JOINTS), [left_rad, right_rad], speeds)]


@pytest.mark.parametrize("counts_on", first_often([True, False]))
def test_an_encoder_that_is_dead_for_a_while_is_the_only_finding(
    command: Command, tmp_path: Path, counts_on: bool
) -> None:
    """The gyro is not blamed for the angle that the wheels miss, nor after the encoder works again."""
    segments = ((0.0, 0.0, 1.0), (0.3, 0.0, 10.0), (0.3, 0.15, 14.0), (0.3, -0.1, 8.0), (0.0, 0.0, 1.0))
    bag = Bag(segments=segments, change=DeadEncoder(counts_on=counts_on))
    track = write_bag(tmp_path / "bag", bag)
    assert import_it(command, tmp_path / "bag") == 0, command.error
    begun = [finding for finding in findings_of(command) if finding["t_s"] is not None]
    assert [finding["name"] for finding in begun] == ["wheels contradicted"]
    assert str(begun[0]["text"]).startswith("wheel 0 does not turn")
    end = end_of(Path("drive.mcap"))
    assert end.contains(track.end)
    rolled_m = 0.3 * 32.0
    assert math.sqrt(end.covariance[0] + end.covariance[3]) < 0.65 * rolled_m


@field_reports
def test_the_wrong_gyro_of_the_field_reports_is_told(command: Command) -> None:
    assert import_it(command, FIELD_BAGS / "gyro_wrong_sign") == 0, command.error
    assert "the gyro has the opposite sign" in command.out
    assert end_of(Path("drive.mcap")).contains(CORNER_END)
    (cause, *_) = findings_of(command)
    assert "wheels +1.571 rad, gyro -1.57" in json.dumps(cause["consequences"])
