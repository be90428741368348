"""The fit that extends a model moves base parameters only where the data asks for it."""

import pytest

from rover_hil.gap.name import _are_apart
from rover_hil.gap.workflow import analyse
from tests.rover_hil.gap_data import cart_runs
from tests.rover_hil.gap_models import Cart


def test_base_parameters_that_nothing_asks_for_stay() -> None:
    findings = analyse(Cart(), cart_runs(8, creep=0.4), seed=8).findings
    assert findings is not None
    assert findings.best is not None
    assert findings.added is not None
    nominal = {item.name: item.nominal for item in Cart.parameters}
    moved = [name for name in nominal if findings.added.point[("", name)] != nominal[name]]
    fitted = [name for name in nominal if findings.best.fit.point[("", name)] != nominal[name]]
    assert len(moved) < len(fitted)
    gain = ("slope_failure", "gain_deg_per_deg")
    error = findings.best.fit.standard_error(gain)
    assert findings.added.value(gain) == pytest.approx(findings.best.fit.value(gain), abs=2.0 * error)


def test_a_base_parameter_that_is_off_moves() -> None:
    """Two deviations of its prior: no gap, but every run shows it."""
    findings = analyse(Cart(), cart_runs(8, creep=0.4, friction=-2.0), seed=8).findings
    assert findings is not None
    assert findings.added is not None
    assert findings.added.point[("", "friction_deg")] == pytest.approx(36.0, abs=1.0)
    assert findings.added.point[("", "height_mm")] == 280.0


def test_effects_that_look_the_same_are_not_tried_together() -> None:
    findings = analyse(Cart(), cart_runs(8, creep=0.4), seed=8).findings
    assert findings is not None
    by_name = {item.card.name: item for item in findings.naming.scores}
    assert not _are_apart(by_name, ("camera_yaw", "camera_yaw"))
    assert _are_apart(by_name, ("camera_yaw", "cog_offset"))
