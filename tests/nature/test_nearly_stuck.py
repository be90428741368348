"""The sites on which the rover nearly gets stuck: their slip is the one that was drawn."""

import functools
import math
from collections.abc import Callable

import numpy as np
import pytest

from sim_backends.world.plant import Plant
from tests.nature.nearly_stuck import (
    HEALTHY_SLIP,
    LAWS,
    STUCK_SLIP,
    Site,
    SitePlant,
    draw_healthy,
    draw_stuck,
    drive_slips,
)

_START_NS = 1_234_567_891
_LAWS = pytest.mark.parametrize("law", LAWS)
_stuck = functools.cache(draw_stuck)


def _places(plant: SitePlant, period_ns: int) -> list[tuple[float, ...]]:
    """Drive for six seconds; return place and wheel angles at every third of them."""
    plant.set_wheel_speeds((-3.0, 0.2, 3.0))
    places = []
    for k in range(1, 4):
        end_ns = _START_NS + k * 2_000_000_000
        while plant.truth().t_ns + period_ns <= end_ns:
            plant.advance(plant.truth().t_ns + period_ns)
        plant.advance(end_ns)
        truth = plant.truth()
        places.append((truth.x_m, truth.y_m, truth.yaw_rad, *truth.wheel_position_rad))
    return places


@_LAWS
@pytest.mark.parametrize(
    ("draw", "limits"), [(_stuck, STUCK_SLIP), (draw_healthy, HEALTHY_SLIP)], ids=["stuck", "healthy"]
)
def test_slip_is_ordinary_before_and_the_target_beyond(
    law: str, draw: Callable[[str, int], Site], limits: tuple[float, float]
) -> None:
    site = draw(law, 1)
    plant: SitePlant = site.plant(_START_NS)
    checked: Plant = plant
    start = checked.truth()
    assert (start.x_m, start.y_m, start.yaw_rad) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert start.t_ns == _START_NS
    assert 0.2 <= site.at_m <= 0.7
    assert limits[0] <= site.steady_slip <= limits[1]
    slips = drive_slips(plant)
    assert slips.before < 0.4
    assert slips.before == pytest.approx(site.ordinary_slip, abs=0.02)
    assert slips.beyond == pytest.approx(site.target_slip, abs=0.02)
    assert slips.beyond == pytest.approx(site.steady_slip, abs=0.01)
    assert slips.straightness > 0.9


@_LAWS
def test_moves_alike_however_often_it_is_asked(law: str) -> None:
    site = _stuck(law, 1)
    assert _places(site.plant(_START_NS), 20_000_000) == _places(site.plant(_START_NS), 7_300_000)


@pytest.mark.parametrize("law", ["tread", "exponential"])
def test_same_seed_same_motion(law: str) -> None:
    site, again = draw_stuck(law, 4), draw_stuck(law, 4)
    assert (site.at_m, site.steady_slip, site.uneven) == (again.at_m, again.steady_slip, again.uneven)
    assert _places(site.plant(_START_NS), 20_000_000) == _places(again.plant(_START_NS), 20_000_000)


def test_the_ground_changes_in_every_direction() -> None:
    site = _stuck("tread", 1)
    for direction_rad in np.linspace(0.0, 2.0 * math.pi, 5, endpoint=False):
        assert drive_slips(site.plant(0), float(direction_rad)).beyond > site.ordinary_slip + 0.2
