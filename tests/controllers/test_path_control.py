"""Guidance along missions, without dynamics: the pose moves as commanded."""

import math
from dataclasses import dataclass

import pytest
from pydantic import TypeAdapter, ValidationError

from controllers.motion.missions.mission import Guidance, PathSettings
from controllers.motion.missions.path_following import CornersMission, PathFollower
from controllers.motion.planar import Pose, move
from controllers.motion.settings import MissionSettings
from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from tests.controllers.mobility import OMNI, SKID, Wheels

ADAPTER: TypeAdapter[MissionSettings] = TypeAdapter(MissionSettings)
DT_S = 0.02


def mission(**values: object) -> CornersMission:
    path = ADAPTER.validate_python(values)
    assert isinstance(path, CornersMission)
    return path


@dataclass
class Track:
    poses: list[Pose]
    guidances: list[Guidance]


def follow(follower: PathFollower, pose: Pose, limit_s: float) -> Track:
    track = Track([pose], [])
    for _ in range(round(limit_s / DT_S)):
        guidance = follower.guide(track.poses[-1], nanoseconds(len(track.guidances) * DT_S))
        track.guidances.append(guidance)
        if guidance.finished:
            break
        track.poses.append(
            move(
                track.poses[-1],
                guidance.velocity_x_m_s * DT_S,
                guidance.velocity_y_m_s * DT_S,
                guidance.yaw_rate_rad_s * DT_S,
            )
        )
    return track


def test_missions_become_corners() -> None:
    assert mission(type="line", length_m=2.0).corners() == ((0.0, 0.0), (2.0, 0.0))
    assert mission(type="rectangle", length_m=0.9, width_m=0.4).corners() == (
        (0.0, 0.0),
        (0.9, 0.0),
        (0.9, 0.4),
        (0.0, 0.4),
        (0.0, 0.0),
    )
    assert mission(type="waypoints", points=[[1, 2], [3, 4]]).corners() == ((0, 0), (1, 2), (3, 4))


@pytest.mark.parametrize(
    ("heading", "moves_sideways"), [("hold", True), ("along_path", True), ("along_path", False)]
)
def test_the_rectangle_is_driven_through_all_corners(heading: str, moves_sideways: bool) -> None:
    rectangle = mission(type="rectangle", length_m=0.9, width_m=0.4, heading=heading, speed_m_s=0.1)
    track = follow(rectangle.follower(Wheels(moves_sideways=moves_sideways)), Pose(), 120.0)
    assert track.guidances[-1].finished
    assert track.guidances[-1].velocity_x_m_s == track.guidances[-1].yaw_rate_rad_s == 0.0
    for corner in rectangle.corners():
        assert min(math.dist(corner, (pose.x_m, pose.y_m)) for pose in track.poses) < 0.015
    assert max(abs(guidance.cross_track_m) for guidance in track.guidances) < 0.03
    speeds = [math.hypot(guidance.velocity_x_m_s, guidance.velocity_y_m_s) for guidance in track.guidances]
    assert max(speeds) == pytest.approx(0.1)
    if heading == "hold":
        assert all(pose.yaw_rad == 0.0 for pose in track.poses)
    else:
        assert track.poses[-1].yaw_rad == pytest.approx(-0.5 * math.pi, abs=0.1)
    if not moves_sideways:
        assert all(guidance.velocity_y_m_s == 0.0 for guidance in track.guidances)


def test_speed_falls_towards_the_corner_and_not_below_a_fifth() -> None:
    line = mission(type="line", length_m=1.0, speed_m_s=0.1, approach_gain_per_s=1.0)
    follower = line.follower(OMNI)
    for x_m, expected in ((0.0, 0.1), (0.9, 0.1), (0.95, 0.05), (0.985, 0.02)):
        assert follower.guide(Pose(x_m=x_m), 0).velocity_x_m_s == pytest.approx(expected)
    assert follower.guide(Pose(x_m=0.991), 0).finished


@pytest.mark.parametrize("moves_sideways", [True, False])
@pytest.mark.parametrize("speed_m_s", [0.1, 0.4])
def test_a_deviation_decays_over_the_lookahead_distance(moves_sideways: bool, speed_m_s: float) -> None:
    line = mission(
        type="line",
        length_m=5.0,
        speed_m_s=speed_m_s,
        heading="along_path",
        lookahead_m=0.5,
        heading_gain_per_s=8.0,
        yaw_rate_limit_rad_s=5.0,
    )
    track = follow(line.follower(Wheels(moves_sideways=moves_sideways)), Pose(y_m=0.1), 120.0)
    assert track.guidances[0].cross_track_m == 0.1
    one_lookahead = next(pose for pose in track.poses if pose.x_m > 0.5)
    assert one_lookahead.y_m == pytest.approx(0.1 * math.exp(-1.0), abs=0.008)
    assert abs(track.poses[-1].y_m) < 0.001


def test_a_skid_steer_rover_turns_on_the_spot_where_it_faces_away() -> None:
    line = mission(type="line", length_m=1.0, heading="along_path")
    guidance = line.follower(SKID).guide(Pose(yaw_rad=1.0), 0)
    assert (guidance.velocity_x_m_s, guidance.yaw_rate_rad_s) == (0.0, -0.5)


def test_the_omni_rover_turns_back_to_the_heading_it_holds() -> None:
    follower = mission(type="line", length_m=1.0, speed_m_s=0.1).follower(OMNI)
    guidance = follower.guide(Pose(yaw_rad=0.1), 0)
    assert guidance.yaw_rate_rad_s == pytest.approx(-0.2)
    assert guidance.velocity_x_m_s == pytest.approx(0.1 * math.cos(0.1))
    assert guidance.velocity_y_m_s == pytest.approx(-0.1 * math.sin(0.1))
    assert follower.guide(Pose(yaw_rad=3.0), 0).yaw_rate_rad_s == -0.5


def test_corners_that_are_already_passed_are_skipped() -> None:
    points = [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]
    follower = mission(type="waypoints", points=points).follower(OMNI)
    guidance = follower.guide(Pose(x_m=2.5), 0)
    assert not guidance.finished
    assert guidance.cross_track_m == pytest.approx(-0.5)
    assert follower.guide(Pose(x_m=2.5, y_m=1.0), 0).finished


def test_each_leg_has_its_speed_and_each_corner_its_stop() -> None:
    path = mission(
        type="waypoints", points=[[1.0, 0.0], [1.0, 1.0]], speeds_m_s=[0.2, 0.05], waits_s=[3.0, 1.0]
    )
    track = follow(path.follower(OMNI), Pose(), 120.0)
    speeds = [math.hypot(each.velocity_x_m_s, each.velocity_y_m_s) for each in track.guidances]
    assert max(speeds) == pytest.approx(0.2)
    first_stop = speeds.index(0.0)
    assert math.dist((track.poses[first_stop].x_m, track.poses[first_stop].y_m), (1.0, 0.0)) < 0.011
    after = next(place for place in range(first_stop, len(speeds)) if speeds[place] > 0.0)
    assert (after - first_stop) * DT_S == pytest.approx(3.0, abs=DT_S)
    assert max(speeds[after:]) == pytest.approx(0.05)
    assert track.guidances[-1].finished
    assert sum(speed == 0.0 for speed in speeds[after:]) * DT_S == pytest.approx(1.0, abs=2 * DT_S)
    assert all(each.yaw_rate_rad_s == 0.0 for each in track.guidances[first_stop:after])


def test_a_rover_that_is_pushed_away_while_it_waits_goes_on_to_wait() -> None:
    follower = mission(type="line", length_m=1.0, wait_s=2.0).follower(OMNI)
    assert not follower.guide(Pose(x_m=1.0), nanoseconds(10.0)).finished
    assert follower.guide(Pose(x_m=0.8), nanoseconds(11.9)).velocity_x_m_s == 0.0
    assert follower.guide(Pose(x_m=0.8), nanoseconds(12.0)).finished


@pytest.mark.parametrize(
    ("values", "corners"),
    [
        ({"type": "line", "length_m": 2.0, "repeat": 2}, [(0, 0), (2, 0), (0, 0), (2, 0)]),
        (
            {"type": "waypoints", "points": [[1, 0], [1, 1]], "repeat": 2},
            [(0, 0), (1, 0), (1, 1), (1, 0), (1, 1)],
        ),
        (
            {"type": "rectangle", "length_m": 2.0, "width_m": 1.0, "repeat": 2},
            [(0, 0), (2, 0), (2, 1), (0, 1), (0, 0), (2, 0), (2, 1), (0, 1), (0, 0)],
        ),
    ],
)
def test_paths_repeat(values: dict[str, object], corners: list[tuple[int, int]]) -> None:
    assert mission(**values).corners() == tuple(corners)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"speeds_m_s": [0.1]}, "speeds_m_s has 1 values for 2 points"),
        ({"waits_s": [1.0, 2.0, 3.0]}, "waits_s has 3 values for 2 points"),
        ({"points": [[1.0, 0.0]] * 20, "repeat": 1000}, "more than 10000"),
    ],
)
def test_lists_that_do_not_fit_are_refused(values: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        mission(**{"type": "waypoints", "points": [[1.0, 0.0], [1.0, 1.0]], **values})


def test_a_skid_steer_rover_cannot_hold_its_heading() -> None:
    assert PathSettings().heading == "hold"
    with pytest.raises(ConfigError, match="along_path"):
        mission(type="line", length_m=1.0).follower(SKID)


@pytest.mark.parametrize(
    "values",
    [
        {"type": "waypoints", "points": [[0.0, 0.01]]},
        {"type": "waypoints", "points": [[1.0, 0.0], [1.0, 0.0]]},
        {"type": "rectangle", "length_m": 0.9, "width_m": 0.3, "position_tolerance_m": 0.3},
    ],
)
def test_lines_that_would_be_skipped_at_once_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="not longer than position_tolerance_m"):
        mission(**values).follower(OMNI)
