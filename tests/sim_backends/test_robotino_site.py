import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ConfigError
from sim_backends.plants.robotino.ground import Ground, rasterise
from sim_backends.plants.robotino.site import PolygonPatch, RectanglePatch, Site, load_site, random_site
from sim_backends.plants.robotino.surfaces import Surface, shipped_surfaces, soft_ground_resistance

RADIUS_M = 0.04


def ground(site: Site, seed: int = 1) -> Ground:
    return rasterise(site, RADIUS_M, np.random.default_rng(seed))


def row_at(laid: Ground, x_m: float, y_m: float) -> list[float]:
    column = math.floor((x_m - laid.x_min_m) * laid.cells_per_m)
    line = math.floor((y_m - laid.y_min_m) * laid.cells_per_m)
    return laid.rows[laid.row[column, line]].tolist()  # type: ignore[no-any-return]


def rectangle(surface: str, **more: object) -> dict[str, object]:
    return {
        "type": "rectangle",
        "surface": surface,
        "x_min_m": 0,
        "x_max_m": 1,
        "y_min_m": 0,
        "y_max_m": 0.5,
    } | more


def surface_numbers(name: str) -> list[float]:
    surface = shipped_surfaces()[name]
    return [surface.friction, surface.stiffness, surface.drag_along, surface.drag_across]


def test_the_last_patch_counts_and_the_floor_is_elsewhere() -> None:
    disc = {"type": "circle", "surface": "green", "x_m": 1.0, "y_m": 0.25, "radius_m": 0.2}
    laid = ground(Site.model_validate({"floor": "brown", "patches": [rectangle("gray"), disc]}))
    assert row_at(laid, 0.5, 0.25)[:4] == surface_numbers("gray")
    assert row_at(laid, 0.9, 0.25)[:4] == surface_numbers("green")
    assert row_at(laid, 1.19, 0.25)[:4] == surface_numbers("green")
    assert row_at(laid, 1.19, 0.0)[:4] == surface_numbers("brown")
    assert laid.rows[0, :4].tolist() == surface_numbers("brown")  # also outside the cells


def test_soft_ground_adds_resistance_and_firm_ground_none() -> None:
    firm = rectangle("red", x_max_m=0.4)
    soft = rectangle("red", x_min_m=0.6, inner="soft", sinkage_m=0.005)
    laid = ground(Site.model_validate({"patches": [firm, soft]}))
    assert row_at(laid, 0.2, 0.2) == [*surface_numbers("red"), 0.0, 0.0]
    along, across = row_at(laid, 0.8, 0.2)[4:]
    assert along == pytest.approx(0.75 * math.sqrt(0.005 / 0.08))
    assert across > along


def test_resistance_of_sinking_is_the_work_of_pressing_the_bed_down() -> None:
    sinkage_m, stiffness = 0.004, 1e7
    half_length_m = math.sqrt(2 * RADIUS_M * sinkage_m)
    x_m = np.linspace(0.0, half_length_m, 10_001)
    depth_m = sinkage_m - x_m**2 / (2 * RADIUS_M)
    load = np.trapezoid(stiffness * depth_m, x_m)
    work_per_way = 0.5 * stiffness * sinkage_m**2
    assert soft_ground_resistance(sinkage_m, RADIUS_M).along == pytest.approx(work_per_way / load, rel=1e-6)


@given(
    st.tuples(*[st.floats(-1, 1)] * 2),
    st.tuples(*[st.floats(0.1, 1)] * 2),
    st.lists(st.tuples(*[st.floats(-2, 2)] * 2), min_size=1, max_size=30),
)
def test_a_polygon_of_four_right_angles_is_a_rectangle(
    corner: tuple[float, ...], size: tuple[float, ...], points: list[tuple[float, ...]]
) -> None:
    (left, low), (width, height) = corner, size
    right, high = left + width, low + height
    box = RectanglePatch(
        type="rectangle", surface="gray", x_min_m=left, x_max_m=right, y_min_m=low, y_max_m=high
    )
    ring = PolygonPatch(
        type="polygon", surface="gray", corners_m=((left, low), (right, low), (right, high), (left, high))
    )
    # Points on the outline may belong to either.
    away = [
        p
        for p in points
        if min(abs(p[0] - left), abs(p[0] - right), abs(p[1] - low), abs(p[1] - high)) > 1e-9
    ]
    x_m, y_m = np.array([p[0] for p in away]), np.array([p[1] for p in away])
    assert box.covers(x_m, y_m).tolist() == ring.covers(x_m, y_m).tolist()


def test_a_polygon_may_be_hollow() -> None:
    hook = PolygonPatch(
        type="polygon",
        surface="gray",
        corners_m=((0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)),
    )
    x_m, y_m = np.array([0.5, 1.5, 2.5, 1.5]), np.array([2.0, 2.0, 2.0, 0.5])
    assert hook.covers(x_m, y_m).tolist() == [True, False, True, True]


def test_roughness_has_the_spread_and_the_length_it_is_given() -> None:
    site = Site.model_validate(
        {"patches": [rectangle("gray")], "roughness": 0.2, "roughness_length_m": 0.05, "cell_m": 0.01}
    )
    rough = ground(site).roughness
    assert rough.mean() == pytest.approx(1.0, abs=0.05)
    assert rough.std() == pytest.approx(0.2, rel=0.02)
    near = np.corrcoef(rough[:-2].ravel(), rough[2:].ravel())[0, 1]
    far = np.corrcoef(rough[:-30].ravel(), rough[30:].ravel())[0, 1]
    assert near > 0.9
    assert abs(far) < 0.3
    assert (ground(site, 1).roughness == rough).all()
    assert (ground(site, 2).roughness != rough).any()


def test_random_sites_differ_cover_the_rectangle_and_repeat() -> None:
    one, again, other = (random_site(np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert one == again
    assert one != other
    xs = [x for patch in one.patches if isinstance(patch, PolygonPatch) for x, _ in patch.corners_m]
    ys = [y for patch in one.patches if isinstance(patch, PolygonPatch) for _, y in patch.corners_m]
    assert (min(xs), min(ys)) < (-0.3, -0.3)
    assert max(xs) > 1.2
    assert max(ys) > 0.7
    many = [patch for seed in range(20) for patch in random_site(np.random.default_rng(seed)).patches]
    assert {patch.surface for patch in many} == {"table", "brown", "gray", "green", "blue"}
    assert 0.15 < np.mean([patch.inner == "soft" for patch in many]) < 0.35


def test_patches_of_a_random_site_leave_no_gap() -> None:
    site = random_site(np.random.default_rng(5))
    x_m, y_m = np.meshgrid(np.linspace(-0.2, 1.1, 131), np.linspace(-0.2, 0.6, 81))
    covers = np.sum([patch.covers(x_m, y_m) for patch in site.patches], axis=0)
    assert covers.min() >= 1


def test_shipped_sites_load_and_lay_out() -> None:
    site = load_site("paper_like")
    assert {patch.surface for patch in site.patches} >= {"green", "gray", "red", "blue", "table"}
    assert any(patch.inner == "soft" for patch in site.patches)
    assert ground(site).row.max() >= 5
    assert load_site("floor_gray").floor == "gray"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ('floor = "carpet"', "no surface 'carpet': name one of table"),
        ("colour = 1", "colour"),
        ("floor = ", "is not valid TOML"),
        ('[[patches]]\ntype = "star"\nsurface = "gray"', "patches.0"),
        (
            '[[patches]]\ntype = "rectangle"\nsurface = "gray"\n'
            "x_min_m = 1\nx_max_m = 0\ny_min_m = 0\ny_max_m = 1",
            "covers nothing",
        ),
    ],
)
def test_a_wrong_map_is_an_error_that_says_what(tmp_path: Path, text: str, part: str) -> None:
    path = tmp_path / "site.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=part) as error:
        load_site(str(path))
    assert str(path) in str(error.value)


def test_a_missing_map_is_an_error() -> None:
    with pytest.raises(ConfigError, match=r"cannot read site .nowhere\.toml"):
        load_site("nowhere.toml")
    with pytest.raises(ConfigError, match="no surface 'moon'"):
        load_site("floor_moon")


def test_a_map_may_bring_its_own_surface() -> None:
    ice = Surface(friction=0.05, stiffness=5, drag_along=0, drag_across=0.01)
    laid = ground(Site(floor="ice", surfaces={"ice": ice}))
    assert laid.rows[0].tolist() == [0.05, 5, 0, 0.01, 0, 0]
