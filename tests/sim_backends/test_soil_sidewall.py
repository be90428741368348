"""Soil wedges at the side walls: textbook limits, and the balance of forces done over again."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from drivers.errors import ModelError
from sim_backends.terramechanics.soil.library import SoilSettings, load_soil
from sim_backends.terramechanics.soil.sidewall import (
    Wall,
    active_factors,
    active_resistance,
    passive_factors,
    passive_resistance,
    wall_polynomials,
)

GRAVITY = 9.81
PHI = math.radians(38.0)
SAND = load_soil("toyoura")
LOAM = SAND.model_copy(
    update={
        "cohesion_pa": 40.0,
        "wall_adhesion_pa": 10.0,
        "wall_friction_deg": 12.0,
        "friction_angle_deg": 33.0,
    }
)


def test_level_smooth_vertical_wall_gives_rankine() -> None:
    wall = Wall(lean=0.0, slope=0.0, soil_friction=PHI, wall_friction=0.0)
    surfaces = np.radians(np.linspace(1.0, 51.0, 50_001))
    passive = min(passive_factors(float(mu), wall, heap=False).weight for mu in surfaces)
    surfaces = np.radians(np.linspace(39.0, 89.0, 50_001))
    active = max(active_factors(float(mu), wall).weight for mu in surfaces)
    assert passive == pytest.approx(math.tan(math.radians(64.0)) ** 2 / 2, rel=1e-7)
    assert passive == pytest.approx(2.1019, abs=5e-5)
    assert active == pytest.approx(math.tan(math.radians(26.0)) ** 2 / 2, rel=1e-7)
    assert active == pytest.approx(0.11894, abs=5e-6)


def _balanced(mu: float, wall: Wall, soil: SoilSettings, height_m: float, *, passive: bool) -> float:
    """Return the force on the wall that closes the polygon of forces on the wedge."""
    lean, slope, phi, delta = wall
    way = 1.0 if passive else -1.0
    top = np.array([-math.tan(lean) * height_m, height_m])
    length = height_m * math.cos(lean - slope) / (math.cos(lean) * math.sin(mu - slope))
    far = length * np.array([math.cos(mu), math.sin(mu)])
    area = 0.5 * abs(top[0] * far[1] - top[1] * far[0])
    if passive:
        # The heap: from the far corner back up at the angle of friction, to the wall's continuation.
        along_wall, back = top / np.hypot(*top), np.array([-math.cos(phi), math.sin(phi)])
        shares = np.linalg.solve(np.stack([along_wall, -back], axis=1), far - top)
        peak = top + shares[0] * along_wall
        across, up = far - top, peak - top
        area += 0.5 * abs(across[0] * up[1] - across[1] * up[0])
    weight = np.array([0.0, -soil.density_kg_m3 * GRAVITY * area])
    wall_down, wall_in = (
        np.array([math.sin(lean), -math.cos(lean)]),
        np.array([math.cos(lean), math.sin(lean)]),
    )
    up_surface, surface_in = np.array([math.cos(mu), math.sin(mu)]), np.array([-math.sin(mu), math.cos(mu)])
    sticking = -way * soil.cohesion_pa * length * up_surface
    sticking += way * soil.wall_adhesion_pa * height_m / math.cos(lean) * wall_down
    push = math.cos(delta) * wall_in + way * math.sin(delta) * wall_down
    reaction = math.cos(phi) * surface_in - way * math.sin(phi) * up_surface
    return float(np.linalg.solve(np.stack([push, reaction], axis=1), -(weight + sticking))[0])


@given(
    lean=st.floats(-0.4, 0.4),
    slope=st.floats(-0.4, 0.4),
    share=st.floats(0.1, 0.9),
    soil=st.sampled_from([SAND, LOAM]),
)
def test_factors_are_the_balance_of_the_wedge(
    lean: float, slope: float, share: float, soil: SoilSettings
) -> None:
    height = 0.03
    wall = Wall(lean, slope, soil.friction_angle_rad, soil.wall_friction_rad)
    for passive in (True, False):
        low = slope if passive else wall.soil_friction
        high = math.pi / 2 + lean - (wall.wall_friction + wall.soil_friction if passive else 0.0)
        assume(high - low > 0.05)  # steep walls on steep slopes leave no slip surface
        mu = low + share * (high - low)
        n_weight, n_cohesion, n_adhesion = passive_factors(mu, wall) if passive else active_factors(mu, wall)
        force = (
            soil.density_kg_m3 * GRAVITY * height**2 * n_weight
            + soil.cohesion_pa * height * n_cohesion
            + soil.wall_adhesion_pa * height * n_adhesion
        )
        assert force == pytest.approx(_balanced(mu, wall, soil, height, passive=passive), rel=1e-9, abs=1e-9)


@settings(deadline=None)
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_passive_exceeds_active(lean: float, slope: float) -> None:
    wall = Wall(lean, slope, PHI, 0.0)
    assert passive_resistance(0.02, wall, SAND, GRAVITY) > active_resistance(0.02, wall, SAND, GRAVITY) > 0.0


def test_sand_needs_one_search_for_all_heights() -> None:
    table = wall_polynomials(SAND, 0.1, 0.2, GRAVITY, 0.097)
    walls = [Wall(-0.1, -0.2, PHI, 0.0), Wall(0.1, 0.2, PHI, 0.0)]
    for height in (0.002, 0.05):
        law = [
            push(height, wall, SAND, GRAVITY) / height
            for wall in walls
            for push in (passive_resistance, active_resistance)
        ]
        assert table[:, 2] * (height / 0.097) == pytest.approx(law, rel=1e-9)


def test_cohesive_soil_is_fitted() -> None:
    radius = 0.097
    table = wall_polynomials(LOAM, 0.1, 0.2, GRAVITY, radius)
    wall = Wall(-0.1, -0.2, LOAM.friction_angle_rad, LOAM.wall_friction_rad)
    for row, law in ((0, passive_resistance), (1, active_resistance)):
        greatest = law(radius, wall, LOAM, GRAVITY)
        for share in np.linspace(0.02, 1.0, 23):
            fitted = np.polynomial.polynomial.polyval(share, table[row, 1:]) * share * radius
            expected = law(share * radius, wall, LOAM, GRAVITY)
            assert (fitted if share > table[row, 0] else 0.0) == pytest.approx(expected, abs=2e-5 * greatest)
    assert 0.0 < table[1, 0] < 1.0, "so cohesive a soil stands without support up to some height"


def test_walls_outside_the_domain_are_refused() -> None:
    with pytest.raises(ModelError, match=r"cross_slope_rad is 0\.7 rad.*friction"):
        wall_polynomials(SAND, 0.7, 0.7, GRAVITY, 0.1)
    with pytest.raises(ModelError, match=r"camber_rad - cross_slope_rad is -0\.95"):
        wall_polynomials(SAND, -0.5, 0.45, GRAVITY, 0.1)
