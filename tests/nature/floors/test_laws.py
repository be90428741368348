"""Tests of the contact laws alone: passivity, and what distinguishes them."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from tests.nature.floors import bristle, carpet, falling, tread, tread_differential
from tests.nature.floors.machine import Floats
from tests.nature.floors.patchwork import Floor
from tests.nature.floors.rover import slip_ratio

pytestmark = pytest.mark.nightly  # a truth generator, which no change of the program touches

_STEP_S = 1.0 / 3600.0
_LOAD_N = 41.0


def _random_motion(seed: int, amplitude: float, steps: int = 20000) -> Floats:
    """Return velocities that turn round often, as sums of sines."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(steps) * _STEP_S
    return sum(
        (
            amplitude / 3.0 * np.sin(2.0 * math.pi * rng.uniform(0.3, 40.0) * t_s + rng.uniform(0.0, 6.0))
            for _ in range(3)
        ),
        np.zeros(steps),
    )


def _tiles(floor: Floor) -> list[Floats]:
    constants = floor.grid.constants
    return [constants[1, column].copy() for column in range(5)]


def _families(seed: int) -> list[Floats]:
    """Return a tile of each family of the ground whose friction falls, by family."""
    constants = falling.draw_floor(seed).grid.constants
    return [constants[constants[:, :, falling.FAMILY] == family][0].copy() for family in range(4)]


def _assert_passive(power_w: list[float]) -> None:
    """Assert that a contact never gave back more energy than it had taken up."""
    energy_j = np.cumsum(power_w) * _STEP_S
    assert energy_j.min() > -1e-3 * energy_j[-1]
    assert energy_j[-1] > 0.0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("amplitude", [0.004, 0.05, 0.3])
class TestPassivity:
    """Work put into the ground is never negative: friction and pile give back no more than they got."""

    def test_bristle(self, seed: int, amplitude: float) -> None:
        for ground in _tiles(bristle.draw_floor(seed)):
            deflection_m, power_w = 0.0, []
            for sliding in _random_motion(seed, amplitude, 4000).tolist():
                level = bristle.friction_level(ground, sliding)
                force_n, deflection_m = bristle.bristle_force(
                    ground, _LOAD_N, level, ground[bristle.VISCOUS], sliding, deflection_m, _STEP_S
                )
                power_w.append(force_n * sliding)
            _assert_passive(power_w)

    @pytest.mark.parametrize("law", ["tread", "falling"])
    def test_running(self, seed: int, amplitude: float, law: str) -> None:
        force, tiles = {
            "tread": (tread.brush_force, _tiles(tread.draw_floor(seed))),
            "falling": (falling.contact_force, _families(seed)),
        }[law]
        sliding_m_s, rim_m_s = _random_motion(seed, amplitude, 4000), _random_motion(seed + 50, 0.2, 4000)
        for ground in tiles:
            deflection_m, power_w = 0.0, []
            for sliding, rim in zip(sliding_m_s.tolist(), rim_m_s.tolist(), strict=True):
                force_n, deflection_m = force(ground, _LOAD_N, sliding, rim, deflection_m, _STEP_S)
                power_w.append(force_n * sliding)
            _assert_passive(power_w)

    def test_tyre(self, seed: int, amplitude: float) -> None:
        for ground in _tiles(tread_differential.draw_floor(seed)):
            tyres = tread_differential.Tyres(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
            along, across, turn = (_random_motion(seed + k, amplitude, 4000).tolist() for k in (0, 1, 2))
            slide_w, scrub_w = [], []
            for a_m_s, b_m_s, c in zip(along, across, turn, strict=True):
                a_n, b_n = tread_differential.brush_vector(
                    ground, 0, tyres, _LOAD_N, a_m_s, b_m_s, 0.1, _STEP_S
                )
                scrub_nm = tread_differential.scrub_moment(ground, 0, tyres, _LOAD_N, 10.0 * c, 0.1, _STEP_S)
                slide_w.append(a_n * a_m_s + b_n * b_m_s)
                scrub_w.append(-scrub_nm * 10.0 * c)
            _assert_passive(slide_w)
            _assert_passive(scrub_w)

    def test_carpet(self, seed: int, amplitude: float) -> None:
        for ground in _tiles(carpet.draw_floor(seed)):
            pile = carpet.Pile(np.zeros(3), np.zeros(3), np.zeros(3))
            tips = np.column_stack([_random_motion(seed + k, amplitude, 4000) for k in (0, 1)])
            turns = np.cumsum(_random_motion(seed + 2, 2.0, 4000)) * _STEP_S
            power_w = []
            for tip, turn, against in zip(tips, turns, _random_motion(seed + 3, 1.0, 4000), strict=True):
                rim_x, rim_y = math.cos(turn), math.sin(turn)
                along_n, across_n = carpet.pile_force(
                    ground, 0, pile, _LOAD_N, against, tip, 0.02, rim_x, rim_y, _STEP_S
                )
                force = np.array([rim_x * along_n + rim_y * across_n, rim_y * along_n - rim_x * across_n])
                power_w.append(float(-force @ tip))
            _assert_passive(power_w)


@pytest.mark.parametrize("seed", range(4))
def test_hub_resistance_opposes_the_motion_at_every_speed(seed: int) -> None:
    for speed_m_s in (0.0, 1e-4, 0.01, 0.15, 1.0):
        for ground in _tiles(tread.draw_floor(seed)):
            assert tread.drag_share(ground, speed_m_s) > 0.0
        for ground in _tiles(carpet.draw_floor(seed)):
            for against in (-1.0, 0.0, 1.0):
                assert carpet.pile_resistance(ground, speed_m_s, against) > 0.0
        for ground in _families(seed):
            for deflection_m in (-1.0, 0.0, 1e-3):
                assert falling.drag_share(ground, speed_m_s, deflection_m) > 0.0


def test_no_load_no_force() -> None:
    ground = bristle.draw_floor(0).grid.constants[0, 0]
    assert bristle.bristle_force(ground, 0.0, 0.3, 1.0, 0.1, 1e-3, _STEP_S)[0] == 0.0
    ground = tread.draw_floor(0).grid.constants[0, 0]
    assert tread.brush_force(ground, 0.0, 0.1, 0.1, 1e-3, _STEP_S)[0] == 0.0
    for ground in _families(0):
        assert falling.contact_force(ground, 0.0, 0.1, 0.1, 1e-3, _STEP_S)[0] == 0.0
    pile = carpet.Pile(np.full(3, 1e-3), np.zeros(3), np.zeros(3))
    ground = carpet.draw_floor(0).grid.constants[0, 0]
    assert carpet.pile_force(ground, 0, pile, 0.0, 0.0, np.ones(2), 0.1, 1.0, 0.0, _STEP_S) == (0.0, 0.0)


def _steady_bristle_n(ground: Floats, sliding_m_s: float) -> float:
    deflection_m, force_n = 0.0, 0.0
    for _ in range(20000):
        level = bristle.friction_level(ground, sliding_m_s)
        force_n, deflection_m = bristle.bristle_force(
            ground, _LOAD_N, level, ground[bristle.VISCOUS], sliding_m_s, deflection_m, _STEP_S
        )
    return force_n


def _tread_n(ground: Floats, sliding_m_s: float, running_m_s: float, travel_m: float) -> float:
    deflection_m, force_n = 0.0, 0.0
    for _ in range(round(travel_m / running_m_s / _STEP_S)):
        force_n, deflection_m = tread.brush_force(
            ground, _LOAD_N, sliding_m_s, running_m_s, deflection_m, _STEP_S
        )
    return force_n


def test_bristle_friction_follows_the_velocity_and_tread_the_ratio() -> None:
    ground = bristle.draw_floor(2).grid.constants[0, 0]
    steady_n = [_steady_bristle_n(ground, sliding) for sliding in (0.01, 0.03, 0.1)]
    assert steady_n[0] * 1.2 < steady_n[1] < steady_n[2] / 1.1
    assert steady_n[1] == pytest.approx(
        _LOAD_N * (bristle.friction_level(ground, 0.03) + ground[bristle.VISCOUS] * 0.03), rel=1e-3
    )
    ground = tread.draw_floor(2).grid.constants[0, 0].copy()
    ground[tread.DAMPING_S_M] = 0.0
    slow_n, fast_n = _tread_n(ground, 0.01, 0.1, 0.2), _tread_n(ground, 0.03, 0.3, 0.2)
    assert slow_n == pytest.approx(fast_n, rel=1e-6)
    assert _tread_n(ground, 0.02, 0.1, 0.2) > 1.2 * slow_n


def test_steady_tread_force_is_the_brush_model() -> None:
    ground = tread.draw_floor(5).grid.constants[0, 0].copy()
    ground[tread.DAMPING_S_M], ground[tread.FRICTION], ground[tread.SLIP_STIFFNESS] = 0.0, 0.5, 3.0
    for slip, force in ((0.1, 3.0 * 0.2 - 3.0 * 0.2**2 + 0.2**3), (0.25, 0.875), (0.6, 1.0)):
        assert _tread_n(ground, slip * 0.15, 0.15, 0.3) == pytest.approx(0.5 * _LOAD_N * force, rel=1e-4)


@pytest.mark.parametrize("length_m", [0.002, 0.02])
@pytest.mark.parametrize("running_m_s", [0.05, 0.3])
def test_relaxation_is_a_lag_in_space(length_m: float, running_m_s: float) -> None:
    ground = tread.draw_floor(0).grid.constants[0, 0].copy()
    ground[tread.DAMPING_S_M], ground[tread.RELAXATION_M] = 0.0, length_m
    sliding_m_s = 1e-4 * running_m_s
    steady_n = _tread_n(ground, sliding_m_s, running_m_s, 10.0 * length_m)
    assert _tread_n(ground, sliding_m_s, running_m_s, length_m) == pytest.approx(
        (1.0 - math.exp(-1.0)) * steady_n, rel=0.05
    )


def _falling_curve(ground: Floats, slips: Sequence[float], rim_m_s: float = 0.15) -> Floats:
    """Return the steady force per load of each slip, of a wheel whose rollers do not turn."""
    forces = []
    for slip in slips:
        deflection_m, force_n = 0.0, 0.0
        for _ in range(round(0.4 / rim_m_s / _STEP_S)):
            force_n, deflection_m = falling.contact_force(
                ground, _LOAD_N, slip * rim_m_s, rim_m_s, deflection_m, _STEP_S
            )
        forces.append(force_n / _LOAD_N)
    return np.array(forces)


@pytest.mark.parametrize("seed", range(8))
class TestFalling:
    def test_tyre_falls_past_its_peak(self, seed: int) -> None:
        ground = _families(seed)[falling.TYRE]
        force = _falling_curve(ground, np.linspace(0.02, 1.0, 50).tolist())
        peak = int(force.argmax())
        assert force[peak] == pytest.approx(ground[falling.FRICTION], rel=0.01)
        assert 0.08 <= 0.02 * (peak + 1) <= 0.32
        assert np.all(np.diff(force[peak:]) < 0.0)
        assert 0.2 < 1.0 - force[-1] / force[peak] < 0.6

    def test_tyre_follows_the_ratio_with_a_short_lag(self, seed: int) -> None:
        ground = _families(seed)[falling.TYRE]
        assert _falling_curve(ground, [0.2], 0.1) == pytest.approx(_falling_curve(ground, [0.2], 0.3))
        assert 0.003 < ground[falling.LENGTH_M] < 0.013

    def test_stribeck_falls_from_static_to_coulomb(self, seed: int) -> None:
        ground = _families(seed)[falling.STRIBECK]
        ground[falling.ROLLER] = 0.0
        assert 1.3 <= ground[falling.STATIC] / ground[falling.FRICTION] <= 2.5
        assert falling.friction_level(ground, 0.0) == pytest.approx(ground[falling.STATIC])
        assert falling.friction_level(ground, 0.3) == pytest.approx(ground[falling.FRICTION])
        ground[falling.FILM], ground[falling.LENGTH_M] = 0.0, 1e9
        force = _falling_curve(ground, np.linspace(0.02, 1.0, 15).tolist())
        assert np.all(np.diff(force) <= 1e-9)
        assert force[-1] < 0.85 * force[0]

    def test_loose_ground_leaves_less_to_pull_with_at_large_slip(self, seed: int) -> None:
        ground = _families(seed)[falling.LOOSE]
        slips = np.linspace(0.05, 1.0, 20)
        force = _falling_curve(ground, slips.tolist())
        u_m = slips * ground[falling.LENGTH_M]
        part = u_m / ground[falling.SHEAR_M]
        shear = ground[falling.FRICTION] * (1.0 - (1.0 - np.exp(-part)) / part)
        assert force == pytest.approx(shear, rel=2e-3)
        resistance = np.array([0.1 * falling.drag_share(ground, 0.1, value) for value in u_m])
        assert np.all(np.diff(resistance) > 0.0)
        assert resistance[-1] > 2.0 * resistance[0]
        # Three hubs share the traction of wheels that point in three directions (pi / 2 on the average).
        pull = force - 0.5 * math.pi * resistance
        assert 0.3 < slips[pull.argmax()] < 0.9
        assert pull[-1] < 0.95 * pull.max()

    def test_wet_friction_falls_then_rises(self, seed: int) -> None:
        ground = _families(seed)[falling.WET]
        force = _falling_curve(ground, np.geomspace(0.005, 1.0, 25).tolist(), 0.3)
        peak = int(np.flatnonzero(np.diff(force) < 0.0)[0])
        valley = peak + int(force[peak:].argmin())
        assert peak < valley < force.size - 1
        assert force[valley] < 0.95 * force[peak]
        assert force[-1] > 1.03 * force[valley]
        assert 0.15 < ground[falling.STATIC] < 0.8
        assert force[valley] < 0.7 * ground[falling.STATIC]

    def test_symmetry_and_rest(self, seed: int) -> None:
        for ground in _families(seed):
            for sliding_m_s, deflection_m in ((0.01, 1e-4), (0.1, -2e-3), (1e-4, 1e-3)):
                ahead = falling.contact_force(ground, _LOAD_N, sliding_m_s, 0.1, deflection_m, _STEP_S)
                back = falling.contact_force(ground, _LOAD_N, -sliding_m_s, -0.1, -deflection_m, _STEP_S)
                assert ahead == (-back[0], -back[1])
            assert falling.contact_force(ground, _LOAD_N, 0.0, 0.1, 0.0, _STEP_S) == (0.0, 0.0)
            # At rest a deflection stays, and so does its force.
            force_n, kept_m = falling.contact_force(ground, _LOAD_N, 0.0, 0.0, 1e-4, _STEP_S)
            assert kept_m == pytest.approx(1e-4)
            assert 0.0 < force_n <= _LOAD_N * ground[falling.STIFFNESS] * 1.001e-4

    def test_half_the_step_changes_little(self, seed: int) -> None:
        for ground in _families(seed):
            ends = []
            for parts in (1, 2):
                deflection_m, work_j = 0.0, 0.0
                t_s = np.arange(3600 * parts) * _STEP_S / parts
                for sliding in (0.05 * np.sin(7.0 * t_s + seed) + 0.02 * np.sin(25.0 * t_s)).tolist():
                    force_n, deflection_m = falling.contact_force(
                        ground, _LOAD_N, sliding, 0.1, deflection_m, _STEP_S / parts
                    )
                    work_j += force_n * sliding * _STEP_S / parts
                ends.append(work_j)
            assert ends[0] == pytest.approx(ends[1], rel=0.02)


def _push_pile(ground: Floats, pile: carpet.Pile, speed_m_s: float, steps: int) -> list[float]:
    """Push the pile across the rim; return the power put into it."""
    power_w = []
    for _ in range(steps):
        _, across_n = carpet.pile_force(
            ground, 0, pile, _LOAD_N, 0.0, np.array([0.0, -speed_m_s]), 0.0, 1.0, 0.0, _STEP_S
        )
        power_w.append(-across_n * speed_m_s)
    return power_w


def test_pile_stores_and_returns_sideways_up_to_the_rollers_drag() -> None:
    ground = carpet.draw_floor(1).grid.constants[0, 0]
    pile = carpet.Pile(np.zeros(3), np.zeros(3), np.zeros(3))
    limit_m = ground[carpet.ROLLER] / ground[carpet.STIFFNESS]
    steps = 20000
    speed_m_s = 0.8 * limit_m / (steps * _STEP_S)
    stored_j = sum(_push_pile(ground, pile, speed_m_s, steps)) * _STEP_S
    back_j = sum(_push_pile(ground, pile, -speed_m_s, steps)) * _STEP_S
    assert stored_j == pytest.approx(
        0.5 * _LOAD_N * ground[carpet.STIFFNESS] * (0.8 * limit_m) ** 2, rel=0.01
    )
    assert back_j == pytest.approx(-stored_j, rel=0.01)
    _push_pile(ground, pile, 3.0 * speed_m_s, steps)
    assert abs(pile.y_m[0]) == pytest.approx(limit_m)


@pytest.mark.parametrize(("bent", "released"), [(-1.0, 1.0), (1.0, -1.0)])
def test_turning_round_in_the_nap_gains_no_energy(bent: float, released: float) -> None:
    ground = carpet.draw_floor(1).grid.constants[0, 0].copy()
    ground[carpet.NAP_STIFFNESS], ground[carpet.DAMPING_S_M] = 0.2, 0.0
    pile = carpet.Pile(np.zeros(3), np.zeros(3), np.zeros(3))
    taken_j = 0.0
    for against, speed_m_s in ((bent, 1e-3), (released, -1e-3)):
        for _ in range(300):
            along_n, _ = carpet.pile_force(
                ground, 0, pile, _LOAD_N, against, np.array([speed_m_s, 0.0]), 0.0, 1.0, 0.0, _STEP_S
            )
            if speed_m_s < 0.0 and along_n > 0.0:
                break
            taken_j -= along_n * speed_m_s * _STEP_S
    stored_j = 0.5 * _LOAD_N * ground[carpet.STIFFNESS] * (300 * _STEP_S * 1e-3) ** 2
    assert 0.1 * stored_j < taken_j < 0.8 * stored_j


def test_nap_resists_more_against_than_along() -> None:
    ground = carpet.draw_floor(1).grid.constants[0, 0]
    along = math.cos(ground[carpet.NAP_RAD]) * 0.15, math.sin(ground[carpet.NAP_RAD]) * 0.15
    assert carpet.against_nap(ground, *along) == pytest.approx(-1.0, abs=5e-3)
    assert carpet.against_nap(ground, -along[0], -along[1]) == pytest.approx(1.0, abs=5e-3)
    assert carpet.pile_resistance(ground, 0.15, 1.0) > 1.04 * carpet.pile_resistance(ground, 0.15, -1.0)


def test_carpet_resistance_saturates_with_speed() -> None:
    ground = carpet.draw_floor(1).grid.constants[0, 0]
    force = [carpet.pile_resistance(ground, speed, 0.0) * speed for speed in (0.05, 0.15, 2.0, 2.1)]
    assert (force[1] - force[0]) / 0.1 > 20.0 * (force[3] - force[2]) / 0.1 > 0.0


@pytest.mark.parametrize(
    ("rim_m_s", "ground_m_s", "slip"),
    [(0.15, 0.12, 0.2), (-0.15, -0.12, 0.2), (0.15, 0.16, 0.0), (0.001, 0.0, 0.0), (0.1, -0.1, 2.0)],
)
def test_slip_counts_when_driving(rim_m_s: float, ground_m_s: float, slip: float) -> None:
    assert slip_ratio(rim_m_s, ground_m_s) == pytest.approx(slip)
