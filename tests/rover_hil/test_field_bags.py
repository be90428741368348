"""Bags as users of other robots record them: the pose is right, refused, or uncertain enough and reported."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import ESTIMATE, ESTIMATE_SHAPE
from rover_hil.report.read_run import read_run
from rover_hil.report.summary import summarise
from rover_hil.report.verdict import facts
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.field_bags import ARC, JOINTS, Bag, States, plain, write_bag

ROOT = Path(__file__).parents[2]
FIELD_BAGS = ROOT.parent / "shared" / "data" / "field_reports" / "bags"
ROVER = ROOT / "docs" / "examples" / "differential.toml"
CORNER_END = (1.0, 1.0, 0.5 * math.pi)
RIGHT_M, RIGHT_RAD = 0.05, 0.05
REGION_2 = 5.99
"""95 % of chi-square with two degrees of freedom, and its square root for one below."""
REGION_1 = 1.96


class End(NamedTuple):
    """Pose, covariance and wheels-only pose of the last cycle of a log."""

    x_m: float
    y_m: float
    yaw_rad: float
    covariance: tuple[float, ...]

    def is_right(self, true: tuple[float, float, float]) -> bool:
        x_m, y_m, yaw_rad = true
        return (
            math.hypot(self.x_m - x_m, self.y_m - y_m) <= RIGHT_M
            and abs(math.remainder(self.yaw_rad - yaw_rad, math.tau)) <= RIGHT_RAD
        )

    def contains(self, true: tuple[float, float, float]) -> bool:
        xx, xy, _, yy, _, yaw_yaw = self.covariance
        error = np.array((true[0] - self.x_m, true[1] - self.y_m))
        turn_rad = math.remainder(true[2] - self.yaw_rad, math.tau)
        distance = float(error @ np.linalg.solve(np.array(((xx, xy), (xy, yy))), error))
        return distance <= REGION_2 and abs(turn_rad) <= REGION_1 * math.sqrt(yaw_yaw)


def end_of(path: Path) -> End:
    log = LogReader(path)
    *_, last = (message for message in log.messages() if message.topic == ESTIMATE)
    estimate = log.parse(last, ESTIMATE_SHAPE)["estimate"]
    return End(estimate["x_m"], estimate["y_m"], estimate["yaw_rad"], tuple(estimate["covariance"]))


def import_it(
    command: Command, bag: Path, *, imu: bool = True, joints: tuple[str, ...] = JOINTS, more: str = ""
) -> int:
    names = ", ".join(f'"{name}"' for name in joints)
    rover = ROVER.read_text("utf-8").replace("rate_hz = 50\ntime_limit_s", "rate_hz = 20\ntime_limit_s")
    Path("rover.toml").write_text(rover.replace('"docs/', f'"{ROOT}/docs/'), "utf-8")
    text = f'rover = "rover.toml"\n[wheels]\ntopic = "/joint_states"\njoints = [{names}]\n{more}\n'
    text += '[imu]\ntopic = "/imu"\n' if imu else ""
    Path("topics.toml").write_text(text + '[truth]\ntopic = "/pose"\n', "utf-8")
    return command("import", "rosbag", str(bag), "--topics", "topics.toml", "--out", "drive.mcap")


field_reports = pytest.mark.skipif(not FIELD_BAGS.is_dir(), reason="field_reports is not there")


@field_reports
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nothing_odd", ()),
        ("velocity_only", ("no angles", "speeds are integrated")),
        ("angles_wrapped", ("wraps after 6.283 rad",)),
        ("one_joint_per_message", ()),
        ("recorded_before_clock", ("recorded before the clock was set", "clock")),
    ],
)
def test_the_bags_of_the_field_reports_are_right(command: Command, name: str, words: tuple[str, ...]) -> None:
    assert import_it(command, FIELD_BAGS / name) == 0, command.error
    assert end_of(Path("drive.mcap")).is_right(CORNER_END)
    for word in words:
        assert word in command.out


@field_reports
def test_dead_encoders_of_the_field_reports_do_not_pass_for_rest(command: Command) -> None:
    assert import_it(command, FIELD_BAGS / "encoders_dead") == 0, command.error
    end = end_of(Path("drive.mcap"))
    assert end.yaw_rad == pytest.approx(0.5 * math.pi, abs=RIGHT_RAD)
    assert math.sqrt(min(end.covariance[0], end.covariance[3])) >= 0.5
    assert end.contains(CORNER_END)
    assert "the wheels are at rest, but motion is reported by gyro and accelerometer" in command.out


def empty_positions(_: float, __: list[float], speeds: list[float]) -> list[States]:
    return [States(list(JOINTS), [], speeds)]


def nan_positions(_: float, __: list[float], speeds: list[float]) -> list[States]:
    return [States(list(JOINTS), [math.nan, math.nan], speeds)]


def one_speed_per_message(_: float, __: list[float], speeds: list[float]) -> list[States]:
    return [States([name], [], [speed]) for name, speed in zip(JOINTS, speeds, strict=True)]


def left_without_position(_: float, angles: list[float], speeds: list[float]) -> list[States]:
    return [States(list(JOINTS), [math.nan, angles[1]], speeds)]


def only_effort(_: float, __: list[float], speeds: list[float]) -> list[States]:
    return [States(list(JOINTS), [], [], speeds)]


def nothing(_: float, __: list[float], ___: list[float]) -> list[States]:
    return [States(list(JOINTS))]


def right_without_anything(_: float, angles: list[float], __: list[float]) -> list[States]:
    return [States(list(JOINTS), [angles[0], math.nan])]


def late_positions(t_s: float, angles: list[float], speeds: list[float]) -> list[States]:
    return [States(list(JOINTS), [math.nan] * 2 if t_s < 3.0 else angles, speeds)]


def lost_positions(t_s: float, angles: list[float], speeds: list[float]) -> list[States]:
    return [States(list(JOINTS), [] if t_s > 6.0 else angles, speeds)]


def wrapped(range_rad: float, low_rad: float, *, speeds: bool = False) -> Callable[..., list[States]]:
    def change(_: float, angles: list[float], true: list[float]) -> list[States]:
        kept = [(angle - low_rad) % range_rad + low_rad for angle in angles]
        return [States(list(JOINTS), kept, true if speeds else [])]

    return change


def wrapped_and_restarted(t_s: float, angles: list[float], _: list[float]) -> list[States]:
    zero_rad = 2.6 * 0.25 / 0.06 if t_s >= 3.6 else 0.0  # 2.6 s at 0.25 m/s
    return [States(list(JOINTS), [(angle - zero_rad) % math.tau for angle in angles])]


def other_node_first(t_s: float, angles: list[float], speeds: list[float]) -> list[States]:
    return [States(["arm", "gripper"], [0.1, 0.2]), *plain(t_s, angles, speeds)]


def other_publisher(t_s: float, angles: list[float], speeds: list[float]) -> list[States]:
    return [States(["arm"], [0.1], node=1), *plain(t_s, angles, speeds)]


def publisher_for_each_wheel(_: float, angles: list[float], __: list[float]) -> list[States]:
    return [
        States([name], [angle], node=k) for k, (name, angle) in enumerate(zip(JOINTS, angles, strict=True))
    ]


def empty_first(t_s: float, angles: list[float], speeds: list[float]) -> list[States]:
    return nothing(t_s, angles, speeds) if t_s < 0.5 else plain(t_s, angles, speeds)


def names_change_places(t_s: float, angles: list[float], speeds: list[float]) -> list[States]:
    if round(t_s * 10) % 2:
        return [States(["arm", *reversed(JOINTS)], [9.0, *reversed(angles)])]
    return plain(t_s, angles, speeds)


def zeros_of_another_node(_: float, __: list[float], speeds: list[float]) -> list[States]:
    return [States(list(JOINTS), [0.0, 0.0]), States(list(JOINTS), [], speeds)]


def zeros_beside_angles(_: float, angles: list[float], __: list[float]) -> list[States]:
    return [States(list(JOINTS), [0.0, 0.0]), States(list(JOINTS), angles)]


class Stuck:
    """Encoders that repeat their angle for a time; then they go on, or jump to the true angle."""

    def __init__(
        self, wheels: tuple[int, ...], from_s: float, until_s: float = math.inf, *, jumps: bool = True
    ) -> None:
        self.wheels, self.from_s, self.until_s, self.jumps = wheels, from_s, until_s, jumps

    def change(self) -> Callable[..., list[States]]:
        held, lost, before = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]

        def states(t_s: float, angles: list[float], _: list[float]) -> list[States]:
            shown = list(angles)
            for wheel in self.wheels:
                if t_s < self.from_s:
                    held[wheel] = angles[wheel]
                elif t_s < self.until_s:
                    shown[wheel] = held[wheel]
                    before[wheel] = angles[wheel]
                    lost[wheel] = before[wheel] - held[wheel]
                elif not self.jumps:
                    shown[wheel] = angles[wheel] - lost[wheel]
            return [States(list(JOINTS), shown)]

        return states


@dataclass(frozen=True)
class Case:
    """A bag with its outcome.

    Attributes:
        outcome: "right"; "refused"; "told": the region contains the truth, and the output has the words.
        words: In the output or in the refusal.
        more: Keys of [wheels].
    """

    bag: Callable[[], Bag]
    outcome: str
    words: tuple[str, ...] = ()
    more: str = ""
    joints: tuple[str, ...] = JOINTS


INTEGRATED = ("no angles, its speeds are integrated",)
REST = ("the wheels are at rest, but motion is reported by",)
COUNTED = ("the turns are counted",)
CASES = {
    # Speeds where there are no angles.
    "speeds at 20 Hz": Case(lambda: Bag(change=empty_positions, wheel_hz=20.0), "right", INTEGRATED),
    "speeds at 50 Hz of an arc": Case(
        lambda: Bag(ARC, nan_positions, wheel_hz=50.0, acceleration_m_s2=0.5), "right", INTEGRATED
    ),
    "speeds, one joint per message": Case(lambda: Bag(change=one_speed_per_message), "told", INTEGRATED),
    "speeds without a gyro": Case(lambda: Bag(ARC, nan_positions, imu="none"), "told", INTEGRATED),
    "one wheel without angles": Case(lambda: Bag(change=left_without_position), "told", INTEGRATED),
    "speeds with a gap": Case(
        lambda: Bag(change=empty_positions, gap_s=(2.0, 5.0)), "told", ("odometry began anew",)
    ),
    "only effort": Case(
        lambda: Bag(change=only_effort),
        "refused",
        ("neither angles nor speeds", "left_wheel", "only efforts"),
    ),
    "empty arrays": Case(lambda: Bag(change=nothing), "refused", ("neither angles nor speeds",)),
    "a wheel with nothing": Case(
        lambda: Bag(change=right_without_anything), "refused", ("neither angles nor speeds of right_wheel",)
    ),
    "angles begin late": Case(lambda: Bag(change=late_positions), "right", ("hold no new angle",)),
    "angles end": Case(lambda: Bag(change=lost_positions), "told", ("hold no new angle",)),
    # Angles that wrap.
    "wraps at one turn from 0": Case(lambda: Bag(change=wrapped(math.tau, 0.0)), "right", COUNTED),
    "wraps at two turns, 20 Hz": Case(
        lambda: Bag(ARC, wrapped(2 * math.tau, -math.tau), wheel_hz=20.0), "right", COUNTED
    ),
    "wraps at 5 Hz": Case(lambda: Bag(change=wrapped(math.tau, -math.pi), wheel_hz=5.0), "right", COUNTED),
    "wraps at 3 Hz": Case(lambda: Bag(change=wrapped(math.tau, -math.pi), wheel_hz=3.0), "right", COUNTED),
    "wraps at 2 Hz": Case(
        lambda: Bag(change=wrapped(math.tau, -math.pi), wheel_hz=2.0),
        "refused",
        ("wraps after 6.283 rad", "every 0.5 s", "limits.wheel_speed_rad_s"),
    ),
    "wraps at 2 Hz with speeds": Case(
        lambda: Bag(change=wrapped(math.tau, 0.0, speeds=True), wheel_hz=2.0), "told", ("integrated",)
    ),
    "wraps at 4 rad, 5 Hz": Case(
        lambda: Bag(change=wrapped(4.0, 0.0), wheel_hz=5.0), "refused", ("wrap_rad",)
    ),
    "wraps too fast to be counted": Case(
        lambda: Bag(((0.0, 0.0, 1.0), (0.4, 0.0, 6.0)), wrapped(math.tau, 0.0), wheel_hz=2.0),
        "refused",
        ("wraps after 6.283 rad", "limits.wheel_speed_rad_s"),
    ),
    "ends before the bag": Case(lambda: Bag(gap_s=(8.0, 99.0)), "told", ("no angle for up to",)),
    "wraps at 10 rad": Case(lambda: Bag(change=wrapped(10.0, 0.0)), "refused", ("wrap_rad",)),
    "wraps at 10 rad, as given": Case(
        lambda: Bag(change=wrapped(10.0, 0.0)), "right", COUNTED, "wrap_rad = 10.0"
    ),
    "wraps with a gap": Case(
        lambda: Bag(change=wrapped(math.tau, -math.pi), gap_s=(2.0, 4.0)), "told", ("odometry began anew",)
    ),
    "wraps and restarts": Case(lambda: Bag(change=wrapped_and_restarted), "told", ("odometry began anew",)),
    # The first message.
    "other joints first": Case(lambda: Bag(change=other_node_first), "right"),
    "two publishers": Case(lambda: Bag(change=other_publisher), "right"),
    "a publisher for each wheel": Case(lambda: Bag(change=publisher_for_each_wheel), "right"),
    "nothing first": Case(lambda: Bag(change=empty_first), "right"),
    "names change places": Case(lambda: Bag(change=names_change_places), "right"),
    "no such joint": Case(
        lambda: Bag(change=other_node_first),
        "refused",
        ("has no joints rear_wheel in any", "arm, gripper, left_wheel, right_wheel"),
        joints=("left_wheel", "rear_wheel"),
    ),
    "zeros and speeds of two nodes": Case(lambda: Bag(change=zeros_of_another_node), "told", REST),
    "zeros and angles of two nodes": Case(
        lambda: Bag(change=zeros_beside_angles), "refused", ("jumps", "several nodes")
    ),
    # Dead encoders.
    "both dead, no accelerometer": Case(lambda: Bag(change=Stuck((0, 1), 3.0).change()), "told", REST),
    "both dead from the start": Case(
        lambda: Bag(ARC, Stuck((0, 1), 0.0).change(), imu="shaking"), "told", REST
    ),
    "both dead, a gentle floor": Case(
        lambda: Bag(change=Stuck((0, 1), 3.0).change(), imu="shaking", shake_m_s2=0.3), "told", REST
    ),
    "both dead, a constant acceleration": Case(
        lambda: Bag(ARC, Stuck((0, 1), 4.0).change(), imu="constant"), "told", REST
    ),
    "left dead": Case(lambda: Bag(change=Stuck((0,), 2.0).change()), "told", ("wheel 0 does not turn",)),
    "right dead in a turn": Case(
        lambda: Bag(change=Stuck((1,), 4.8, 8.5, jumps=False).change()), "told", ("wheel 1 does not turn",)
    ),
    "both dead in a turn": Case(
        lambda: Bag(change=Stuck((0, 1), 4.9, 8.3, jumps=False).change()), "told", REST
    ),
    "both dead in a turn, then right": Case(
        lambda: Bag(change=Stuck((0, 1), 4.9, 8.3).change()), "told", REST
    ),
    "both dead for a second": Case(
        lambda: Bag(change=Stuck((0, 1), 2.0, 3.0).change(), imu="gyro"), "told", ("odometry began anew",)
    ),
    "gyro with an offset": Case(lambda: Bag(offset_rad_s=0.03), "right"),
    "gyro with a great offset": Case(lambda: Bag(offset_rad_s=0.12), "told", REST),
    "gyro with a great offset, shaking": Case(
        lambda: Bag(offset_rad_s=0.12, imu="shaking", segments=ARC), "told", REST
    ),
    "a healthy rover that shakes": Case(lambda: Bag(imu="shaking", acceleration_m_s2=0.5), "right"),
    # Times.
    "zeros at first": Case(
        lambda: Bag(time_ns=lambda t_ns: 0 if t_ns < 500_000_000 else 10**18 + t_ns),
        "right",
        ("recorded before the clock was set", "left out"),
    ),
    "zeros in the middle": Case(
        lambda: Bag(time_ns=lambda t_ns: 0 if t_ns % 10**9 == 5 * 10**8 else 10**18 + t_ns),
        "right",
        ("recorded before the clock was set", "left out"),
    ),
    "a clock that is set": Case(
        lambda: Bag(time_ns=lambda t_ns: t_ns + 10**9 if t_ns < 800_000_000 else 10**18 + t_ns),
        "right",
        ("recorded before the clock was set", "left out"),
    ),
}
REPEATED = {
    "speeds at 50 Hz of an arc",
    "wraps at two turns, 20 Hz",
    "wraps at 5 Hz",
    "wraps at 3 Hz",
    "wraps with a gap",
    "two publishers",
    "both dead from the start",
    "both dead, a gentle floor",
    "both dead, a constant acceleration",
    "both dead in a turn, then right",
    "gyro with a great offset, shaking",
    "zeros in the middle",
    "a clock that is set",
}
"""They repeat another case at another rate, on another way or in another part of the bag."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.nightly) if name in REPEATED else name for name in CASES]
)
def test_a_bag_is_right_or_refused_or_told(command: Command, name: str) -> None:
    case = CASES[name]
    bag = case.bag()
    track = write_bag(Path("bag"), bag)
    code = import_it(command, Path("bag"), imu=bag.imu != "none", joints=case.joints, more=case.more)
    if case.outcome == "refused":
        assert code == 2
        assert_one_sentence(command.error, *case.words)
        assert not Path("drive.mcap").exists()
        return
    assert code == 0, command.error
    end = end_of(Path("drive.mcap"))
    for word in case.words:
        assert word in command.out
    if case.outcome == "right":
        assert end.is_right(track.end)
    assert end.contains(track.end)


def test_the_report_tells_new_bases_and_contradictions(command: Command) -> None:
    write_bag(Path("bag"), Bag(ARC, Stuck((0, 1), 3.0, 6.0).change()))
    assert import_it(command, Path("bag")) == 0, command.error
    found = {fact.name: fact for fact in facts(summarise(read_run(Path("drive.mcap"))))}
    assert found["odometry anew"].value == "1"
    assert "motion is reported by gyro" in found["may be wrong"].detail
    assert command("replay", "drive.mcap") == 0
    assert "every output identical" in command.out


def test_an_imported_wrap_replays(command: Command) -> None:
    write_bag(Path("bag"), replace(Bag(), change=wrapped(math.tau, 0.0)))
    assert import_it(command, Path("bag")) == 0
    assert command("replay", "drive.mcap") == 0
    assert "every output identical" in command.out
