import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from controllers.slip.effort.surface_map import (
    DirectionCurve,
    SurfaceEstimate,
    SurfaceMap,
    SurfaceModel,
    SurfaceTracker,
    Travel,
)

ALL_AROUND = tuple(math.radians(degrees) for degrees in range(-180, 180, 20))
STEP_S = 0.1


def surface(name: str, force_n: float, slip: float) -> SurfaceModel:
    # Force and slip change with direction, as on the real rover.
    return SurfaceModel(
        name=name,
        force_n=DirectionCurve(mean=force_n, cosines=(0.0, 2.0), sines=(0.0, 0.0)),
        slip=DirectionCurve(mean=slip, cosines=(0.0, 0.1 * slip), sines=(0.0, 0.0)),
        drift_rad=DirectionCurve(mean=0.1 * slip, cosines=(0.0, 0.0), sines=(0.05, 0.0)),
        force_window_sd_n=1.0,
        force_run_sd_n=0.3,
        speed_range_m_s=(0.1, 0.3),
    )


TABLE, CARPET, LAWN = surface("table", 3.0, 0.0), surface("carpet", 12.0, 0.1), surface("lawn", 28.0, 0.5)
MAP = SurfaceMap(surfaces=(LAWN, TABLE, CARPET), directions_rad=ALL_AROUND)


def drive(
    tracker: SurfaceTracker,
    force_n: float,
    *,
    direction_rad: float = 0.3,
    speed_m_s: float = 0.2,
    yaw_rate_rad_s: float = 0.0,
    duration_s: float = 2.0,
) -> SurfaceEstimate:
    """Drive with a force above the mean of the surfaces' curve in this direction."""
    force_n += 2.0 * math.cos(2 * direction_rad)
    way_m = speed_m_s * STEP_S
    for _ in range(round(duration_s / STEP_S)):
        estimate = tracker.step(
            Travel(
                STEP_S,
                way_m * math.cos(direction_rad),
                way_m * math.sin(direction_rad),
                yaw_rate_rad_s * STEP_S,
                force_n * way_m,
            )
        )
    return estimate


@pytest.mark.parametrize("model", [TABLE, CARPET, LAWN])
@pytest.mark.parametrize("direction_rad", [-3.0, -1.2, 0.0, 0.7, 2.0])
def test_known_surfaces_are_recognised_in_every_direction(model: SurfaceModel, direction_rad: float) -> None:
    estimate = drive(SurfaceTracker(MAP, 0.125), model.force_n.mean, direction_rad=direction_rad)
    assert (estimate.surface, estimate.valid) == (model.name, True)
    assert estimate.slip == pytest.approx(model.slip.at(direction_rad, 0.2), abs=0.01)


@pytest.mark.parametrize(("force_n", "slip"), [(20.0, 0.3), (60.0, 0.5), (-30.0, 0.0)])
def test_unknown_surfaces_are_said_to_be_unknown(force_n: float, slip: float) -> None:
    estimate = drive(SurfaceTracker(MAP, 0.125), force_n)
    assert (estimate.surface, estimate.valid) == (None, False)
    assert estimate.reason.startswith("unknown surface")
    # Between two surfaces the slip is between theirs; beyond all of them it is held.
    assert estimate.slip == pytest.approx(slip, abs=0.07)


@given(st.floats(-1e3, 1e3), st.floats(-math.pi, math.pi))
def test_slip_stays_between_the_known_slips(force_n: float, direction_rad: float) -> None:
    slip = drive(SurfaceTracker(MAP, 0.125), force_n, direction_rad=direction_rad, duration_s=0.6).slip
    slips = [model.slip.at(direction_rad, 0.2) for model in MAP.surfaces]
    assert min(slips) - 1e-9 <= slip <= max(slips) + 1e-9


def test_a_new_surface_is_noticed_within_a_second() -> None:
    tracker = SurfaceTracker(MAP, 0.125)
    drive(tracker, 3.0, duration_s=5.0)
    assert drive(tracker, 28.0, duration_s=1.0).surface == "lawn"


def test_averaging_tells_close_surfaces_apart() -> None:
    close = SurfaceMap(surfaces=(surface("a", 10.0, 0.1), surface("b", 12.0, 0.5)), directions_rad=ALL_AROUND)
    tracker = SurfaceTracker(close, 0.125)
    first = drive(tracker, 10.4, duration_s=0.5)
    later = drive(tracker, 10.4, duration_s=3.0)
    assert abs(later.slip - 0.1) < abs(first.slip - 0.1)


def test_range_of_training_is_flagged() -> None:
    half = SurfaceMap(surfaces=MAP.surfaces, directions_rad=(0.0, 0.5, 1.0))
    backwards = drive(SurfaceTracker(half, 0.125), 3.0, direction_rad=math.pi)
    assert (backwards.valid, backwards.reason) == (False, "direction 180 deg is outside the training range")
    fast = drive(SurfaceTracker(MAP, 0.125), 3.0, speed_m_s=0.5)
    assert (fast.valid, fast.reason) == (False, "speed 0.5 m/s is outside the training range")
    turning = drive(SurfaceTracker(MAP, 0.125), 3.0, yaw_rate_rad_s=1.0)
    assert (turning.valid, turning.reason) == (False, "turning: the map is one of straight travel")


@pytest.mark.parametrize("speed_m_s", [0.0, 0.01])
def test_a_standing_rover_gives_no_judgement(speed_m_s: float) -> None:
    estimate = drive(SurfaceTracker(MAP, 0.125), 3.0, speed_m_s=speed_m_s)
    assert not estimate.valid
    assert math.isfinite(estimate.slip)


def test_before_the_first_window_the_slip_is_not_valid() -> None:
    estimate = drive(SurfaceTracker(MAP, 0.125), 3.0, duration_s=0.3)
    assert (estimate.valid, estimate.surface) == (False, None)
    assert estimate.slip == pytest.approx(0.2)


def test_being_told_the_surface_leaves_the_others_out() -> None:
    estimate = drive(SurfaceTracker(MAP.only(["lawn"]), 0.125), 3.0)
    assert estimate.slip == pytest.approx(0.5, abs=0.05)
    assert not estimate.valid


def test_curves_are_held_beyond_trained_speeds() -> None:
    model = TABLE.model_copy(update={"speed_range_m_s": (0.1, 0.12)})
    assert [model.held_speed_m_s(speed) for speed in (0.05, 0.11, 0.3)] == [0.1, 0.11, 0.12]


def test_surfaces_of_one_name_are_refused() -> None:
    with pytest.raises(ValidationError, match="different names"):
        SurfaceMap(surfaces=(TABLE, TABLE), directions_rad=(0.0,))
