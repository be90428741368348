"""The comparison of known tracks: travel by a camera, poses with a yaw, groups of sources."""

import math
from collections.abc import Callable

import pytest

from controllers.check_manoeuvre.comparison import compare, confirmed_by
from controllers.check_manoeuvre.tracks import Tracks
from controllers.check_manoeuvre.verdict import SourceCheck, Verdict
from controllers.estimation.ground.travel import GroundPair
from controllers.estimation.settings import FilterSettings
from controllers.ground_motion.motion import GroundMotion
from controllers.motion.planar import Pose
from controllers.roles import DeviceRoles
from drivers.samples import HeadingReference, HeadingSample, PoseFixSample, RateSample

STEP_NS, STEP_S = 20_000_000, 0.02
RATE_RAD_S = 0.2
FLOOR_RAD = 2.0
"""Yaw of the local frame on the floor of the camera."""


def ground_pair(rolled_m: float, ground_m: float) -> GroundPair:
    motion = GroundMotion(
        from_ns=0,
        to_ns=0,
        point_m=(0.0, 0.0),
        foot_m=(0.0, 0.0),
        forward_m=ground_m,
        left_m=0.0,
        turn_rad=0.0,
        forward_sd_m=0.001,
        left_sd_m=0.001,
        turn_sd_rad=0.01,
        scale_sd=0.01,
        direction_sd_rad=0.0,
    )
    return GroundPair(complex(rolled_m), complex(ground_m), 0.0, motion)


def true_motion() -> list[tuple[float, float, float]]:
    """Return x, y and yaw of a rover that rotates to both sides, and drives forth and back there."""
    poses, yaw_rad = [], 0.0
    for sign, seconds in ((1.0, 1.75), (0.0, 6.0), (-1.0, 3.5), (0.0, 6.0), (1.0, 1.75)):
        steps = round(seconds / STEP_S)
        for step in range(steps):
            travel_m = 0.0 if sign else 0.1 * STEP_S * min(step, steps - step)
            yaw_rad += sign * RATE_RAD_S * STEP_S
            poses.append((travel_m * math.cos(yaw_rad), travel_m * math.sin(yaw_rad), yaw_rad))
    return poses


def tracked(
    roles: DeviceRoles,
    *,
    rate: Callable[[float], float] = lambda rate: rate,
    heading: Callable[[float], float] = lambda heading: heading,
    place: Callable[[complex], complex] = lambda place: place,
    wheels: float = 1.0,
) -> Tracks:
    """Return what sources measure of this motion; `wheels` is their share of the true rotation."""
    tracks, before_rad = Tracks(roles, FilterSettings()), 0.0
    for number, (x_m, y_m, yaw_rad) in enumerate(true_motion()):
        t_ns = number * STEP_NS
        tracks.take_wheels(t_ns, Pose(x_m=x_m, y_m=y_m, yaw_rad=wheels * yaw_rad))
        rate_rad_s = rate((yaw_rad - before_rad) / STEP_S)
        tracks.take(RateSample(device="gyro", t_ns=t_ns, rate_z_rad_s=rate_rad_s), t_ns)
        compass = HeadingSample(
            device="compass",
            t_ns=t_ns,
            heading_rad=math.remainder(heading(yaw_rad) + 1.0, math.tau),
            reference=HeadingReference.MAGNETIC,
        )
        tracks.take(compass, t_ns)
        if number % 10 == 0:
            seen = place(complex(x_m, y_m) * complex(math.cos(FLOOR_RAD), math.sin(FLOOR_RAD)))
            fix = PoseFixSample(
                device="overhead",
                t_ns=t_ns,
                x_m=seen.real,
                y_m=seen.imag,
                yaw_rad=math.remainder(yaw_rad + FLOOR_RAD, math.tau),
                position_std_m=0.005,
                yaw_std_rad=0.01,
                t_capture_ns=t_ns,
            )
            tracks.take(fix, t_ns)
        before_rad = yaw_rad
    return tracks


ALL = DeviceRoles(
    wheels="wheels", gyro="gyro", headings=("compass",), fixes=("overhead",), camera="rear", required={}
)


def verdicts(checks: tuple[SourceCheck, ...]) -> dict[tuple[str, str], Verdict]:
    return {(check.device, check.quantity): check.verdict for check in checks}


def test_sound_sources_all_agree_and_are_confirmed() -> None:
    checks = compare(tracked(ALL), ALL, skids=False)
    assert set(verdicts(checks).values()) == {Verdict.AGREES}
    assert len(checks) == 5
    assert confirmed_by(checks) == {"wheels", "gyro", "compass", "overhead"}


@pytest.mark.parametrize(
    ("place", "verdict"),
    [
        (lambda place: -place, Verdict.DIRECTION),
        (lambda place: place.conjugate(), Verdict.MIRRORED),
        (lambda place: 0.0 * place + 1.0, Verdict.DOES_NOT_FOLLOW),
        (lambda place: 0.4 * place, Verdict.SCALE),
        (lambda place: math.nan * place, Verdict.NOT_COMPARED),
    ],
    ids=["backwards", "mirrored", "frozen", "scaled", "not finite"],
)
def test_wrong_positions_are_named(place: Callable[[complex], complex], verdict: Verdict) -> None:
    checks = compare(tracked(ALL, place=place), ALL, skids=False)
    assert verdicts(checks)["overhead", "position"] is verdict
    assert "overhead" not in confirmed_by(checks) or verdict is Verdict.NOT_COMPARED
    assert {"wheels", "gyro", "compass"} <= confirmed_by(checks)


def test_the_majority_decides_which_source_is_wrong() -> None:
    checks = compare(tracked(ALL, rate=lambda rate: -rate), ALL, skids=False)
    wrong = [check.device for check in checks if check.verdict is Verdict.OPPOSITE]
    assert wrong == ["gyro"]
    checks = compare(tracked(ALL, wheels=-1.0), ALL, skids=False)
    rotations = [check.device for check in checks if check.verdict is Verdict.OPPOSITE]
    assert rotations == ["wheels"]


def test_with_two_sources_the_line_names_both() -> None:
    roles = DeviceRoles(wheels="wheels", gyro="gyro", required={})
    (check,) = compare(tracked(roles, rate=lambda rate: -rate), roles, skids=False)
    assert (check.device, check.verdict) == ("gyro", Verdict.OPPOSITE)
    assert "rover-hil calibrate imu" in check.text
    assert "exchange left and right wheels" in check.text


@pytest.mark.parametrize(("skids", "verdict"), [(True, Verdict.AGREES), (False, Verdict.SCALE)])
def test_wheels_that_skid_may_turn_further(skids: bool, verdict: Verdict) -> None:
    roles = DeviceRoles(wheels="wheels", gyro="gyro", required={})
    checks = compare(tracked(roles, wheels=3.0), roles, skids=skids)
    assert checks[-1].verdict is verdict


@pytest.mark.parametrize(
    ("share", "verdict"),
    [(1.0, Verdict.AGREES), (0.7, Verdict.AGREES), (-1.0, Verdict.OPPOSITE), (0.0, Verdict.DOES_NOT_FOLLOW)],
)
def test_the_travel_by_a_camera_is_compared_with_the_wheels(share: float, verdict: Verdict) -> None:
    tracks = tracked(ALL)
    for sign in (1.0, -1.0):
        tracks.take_ground(tuple(ground_pair(sign * 0.01, share * sign * 0.01) for _ in range(30)))
    checks = compare(tracks, ALL, skids=False)
    assert verdicts(checks)["rear", "travel"] is verdict


@pytest.mark.parametrize(
    ("share", "advice"), [(0.0, "the wheels have no grip"), (0.4, "the grip of the wheels"), (-1.0, "")]
)
def test_wheels_that_agree_in_rotations_may_slip_ahead(share: float, advice: str) -> None:
    tracks = tracked(ALL)
    for sign in (1.0, -1.0):
        tracks.take_ground(tuple(ground_pair(sign * 0.01, share * sign * 0.01) for _ in range(30)))
    [check] = [each for each in compare(tracks, ALL, skids=False) if each.quantity == "travel"]
    assert advice in check.text
    assert ("wheels" in check.text.partition(";")[2]) is bool(advice)
