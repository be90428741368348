"""The table of wheel forces against the model it stands for."""

from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ModelError
from sim_backends.plants.el_dorado import wheel_table
from sim_backends.plants.el_dorado.dynamics import look_up, wheel_shares
from sim_backends.plants.el_dorado.wheel_table import WheelTable, build_table, load_table
from sim_backends.terramechanics.soil.library import SoilSettings, load_soil, load_wheel
from sim_backends.terramechanics.soil.wheel_forces import wheel_at_load

LOAD_N = 64.75
WHEEL = load_wheel("el_dorado")


@pytest.fixture(scope="module")
def table() -> WheelTable:
    return load_table(WHEEL, load_soil("toyoura"), LOAD_N)


@pytest.mark.parametrize(
    ("slips", "angles_deg", "rms", "worst"),
    [((-0.2, 0.6), (-20, 20), 0.006, 0.03), ((-0.85, 0.95), (-60, 60), 0.008, 0.04)],
)
def test_it_is_near_the_model_between_its_nodes(
    table: WheelTable, slips: tuple[float, float], angles_deg: tuple[float, float], rms: float, worst: float
) -> None:
    """Errors in shares of the load, at random loads, slips and slip angles, for several cambers."""
    rng = np.random.default_rng(5)
    errors = []
    for camber in (-0.25, -0.1, 0.06, 0.2):
        load, slip = rng.uniform(0.2, 2.5, 60) * LOAD_N, rng.uniform(*slips, 60)
        angle = np.radians(rng.uniform(*angles_deg, 60))
        _, exact = wheel_at_load(
            WHEEL,
            load_soil("toyoura"),
            load_n=load,
            slip=slip,
            slip_angle_rad=angle,
            camber_rad=camber,
            bound=1e-5,
        )
        forward = np.where(slip < 0, 1.0, 1.0 - slip)
        side = np.arctan(forward * np.tan(angle))
        found = [look_up(table, *row, camber) for row in zip(load, slip, side, strict=True)]
        shares = np.stack([exact.drawbar_n, exact.side_n, exact.torque_nm / WHEEL.radius_m], axis=1)
        errors.append(np.array(found) - shares / load[:, np.newaxis])
    error = np.concatenate(errors)
    assert np.sqrt(np.mean(error**2, axis=0)).max() < rms
    assert np.abs(error).max() < worst


def test_speeds_of_any_size_in_one_ratio_give_the_same_forces(table: WheelTable) -> None:
    slow, fast = (wheel_shares(table, 60.0, s * 0.1, s * 0.07, s * -0.02, 0.0) for s in (1e-3, 1.0))
    assert slow == pytest.approx(fast)


def test_a_wheel_pushed_against_its_turning_resists_more_and_more(table: WheelTable) -> None:
    drawbars = [wheel_shares(table, 60.0, 0.1, speed, 0.0, 0.0)[0] for speed in (0.05, 0.0, -0.03, -0.06)]
    assert drawbars == sorted(drawbars)
    assert drawbars[3] > drawbars[1] + 0.5


def test_the_mirror_image_of_a_wheel_has_mirrored_forces(table: WheelTable) -> None:
    left, right = (
        wheel_shares(
            table,
            60.0,
            0.1,
            0.07,
            side * 0.02,
            side * 0.1,
        )
        for side in (1, -1)
    )
    assert left[0] == pytest.approx(right[0])
    assert left[1] == pytest.approx(-right[1])
    assert left[1] < 0


def test_a_soil_that_bears_nothing_is_refused() -> None:
    weak = load_soil("toyoura")
    weak = weak.model_copy(update={"pressure": weak.pressure.model_copy(update={"k_phi": 0.1})})
    with pytest.raises(ModelError, match="does not bear a wheel under 233 N"):
        build_table(WHEEL, weak, LOAD_N)


def test_a_table_is_computed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    small = WheelTable(np.ones(2), np.ones(2), np.ones(2), np.ones(2), np.ones((2, 2, 2, 2, 3)))

    def build(wheel: object, soil: SoilSettings, load_n: float) -> WheelTable:
        calls.append(soil.friction_angle_deg)
        return small

    monkeypatch.setattr(wheel_table, "build_table", build)
    monkeypatch.setattr(wheel_table, "cache_folder", lambda: tmp_path)
    soil = load_soil("toyoura")
    first, second = (load_table(WHEEL, soil, LOAD_N) for _ in range(2))
    assert calls == [38.0]
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))
    load_table(WHEEL, soil.model_copy(update={"friction_angle_deg": 30.0}), LOAD_N)
    assert calls == [38.0, 30.0]
    (stored, _) = sorted(tmp_path.iterdir())
    for file in tmp_path.iterdir():
        file.write_bytes(stored.read_bytes()[:100])
    load_table(WHEEL, soil, LOAD_N)
    assert calls == [38.0, 30.0, 38.0]
