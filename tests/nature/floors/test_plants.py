"""Tests of the whole rovers, and of the floors they are drawn with."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pytest

from sim_backends.world.plant import Plant, Truth
from tests.nature.floors import (
    NATURES,
    BristlePlant,
    CarpetPlant,
    DifferentialTreadPlant,
    FallingPlant,
    Nature,
    RoverPlant,
    bristle,
    carpet,
    falling,
    tread,
    tread_differential,
)
from tests.nature.floors.__main__ import drive_slips
from tests.nature.floors.machine import NANOSECONDS, Floats, draw_machine
from tests.nature.floors.measure import wheel_speeds
from tests.nature.floors.patchwork import Floor

pytestmark = pytest.mark.nightly  # a truth generator, which no change of the program touches

_ALL = pytest.mark.parametrize("nature", NATURES, ids=lambda nature: nature.name)
_OMNI = pytest.mark.parametrize(
    "nature", [nature for nature in NATURES if nature.plant.wheel_count == 3], ids=lambda nature: nature.name
)
_START_NS = 1_234_567_891


def _plant(
    nature: Nature, seed: int = 3, *, floor: Floor | None = None, substeps: int = 4, lifted: bool = False
) -> RoverPlant:
    floor = nature.draw_floor(seed) if floor is None else floor
    return nature.plant(floor, np.random.default_rng(seed), _START_NS, substeps=substeps, lifted=lifted)


def _run(plant: RoverPlant, seconds: float, period_s: float = 0.02) -> list[Truth]:
    """Advance and return the truth once per period."""
    start_ns = plant.truth().t_ns
    truths = []
    for k in range(1, round(seconds / period_s) + 1):
        plant.advance(start_ns + round(k * period_s * NANOSECONDS))
        truths.append(plant.truth())
    return truths


def _drive(plant: RoverPlant, x_m_s: float, y_m_s: float, yaw_rate_rad_s: float) -> None:
    plant.set_wheel_speeds(wheel_speeds(plant, x_m_s, y_m_s, yaw_rate_rad_s))


def _with_machine(floor: Floor, **values: float) -> Floor:
    return dataclasses.replace(floor, machine=floor.machine._replace(**values))


def _place(truth: Truth) -> Floats:
    return np.array([truth.x_m, truth.y_m, truth.yaw_rad])


@_ALL
class TestInterface:
    def test_is_a_plant(self, nature: Nature) -> None:
        plant = _plant(nature)
        assert isinstance(plant, RoverPlant)
        checked: Plant = plant
        assert checked.wheel_count == len(checked.truth().wheel_speed_rad_s)
        with pytest.raises(ValueError, match="setpoints"):
            plant.set_wheel_speeds([1.0])

    def test_starts_at_rest_at_the_origin(self, nature: Nature) -> None:
        truth = _plant(nature).truth()
        assert np.allclose(_place(truth), 0.0, atol=1e-15)
        assert truth.t_ns == _START_NS
        assert truth.slip == (0.0,) * len(truth.slip)

    def test_same_seed_same_run_however_often_it_is_asked(self, nature: Nature) -> None:
        ends = []
        for period_s in (0.02, 0.0073, 0.5):
            plant = _plant(nature)
            _drive(plant, 0.1, 0.05, 0.2)
            _run(plant, 0.5, 0.5)
            _drive(plant, -0.1, 0.05, 0.1)
            _run(plant, 1.0, period_s)
            plant.advance(_START_NS + 2 * NANOSECONDS)
            ends.append(plant.truth())
        assert ends[0] == ends[1] == ends[2]

    def test_time_never_goes_back(self, nature: Nature) -> None:
        plant = _plant(nature)
        _drive(plant, 0.15, 0.0, 0.0)
        plant.advance(_START_NS + NANOSECONDS)
        before = plant.truth()
        plant.advance(_START_NS)
        assert plant.truth() == before

    def test_set_points_come_late(self, nature: Nature) -> None:
        plant = _plant(nature)
        _drive(plant, 0.15, 0.0, 0.0)
        plant.advance(_START_NS + 75_000_000)
        assert not any(plant.truth().wheel_speed_rad_s)
        plant.advance(_START_NS + 250_000_000)
        assert max(map(abs, plant.truth().wheel_speed_rad_s)) > 1.0

    def test_rates_are_derivatives(self, nature: Nature) -> None:
        plant = _plant(nature)
        _drive(plant, 0.1, 0.0, 0.6)
        _run(plant, 1.0, 0.5)
        truths = _run(plant, 1.0, 0.001)
        place = np.array([_place(truth) for truth in truths])
        rate = (place[2:] - place[:-2]) / 0.002
        for derivative, truth in zip(rate, truths[1:-1], strict=True):
            cosine, sine = math.cos(truth.yaw_rad), math.sin(truth.yaw_rad)
            x_m_s = cosine * truth.velocity_x_m_s - sine * truth.velocity_y_m_s
            y_m_s = sine * truth.velocity_x_m_s + cosine * truth.velocity_y_m_s
            assert derivative[:2] == pytest.approx([x_m_s, y_m_s], abs=3e-3)
            assert derivative[2] == pytest.approx(truth.yaw_rate_rad_s, abs=0.02)
        assert place[-1, 2] - place[0, 2] == pytest.approx(
            0.001 * sum(truth.yaw_rate_rad_s for truth in truths[1:]), rel=5e-3
        )
        assert abs(place[-1, 2]) > 0.2

    def test_wheels_reach_their_set_points_and_currents_drive_forward(self, nature: Nature) -> None:
        plant = _plant(nature)
        _drive(plant, 0.15, 0.0, 0.0)
        truths = _run(plant, 3.0)[100:]
        wanted = wheel_speeds(plant, 0.15, 0.0, 0.0)
        speed = np.mean([truth.wheel_speed_rad_s for truth in truths], axis=0)
        assert speed == pytest.approx(wanted, abs=0.1)
        current = np.mean([truth.motor_current_a for truth in truths], axis=0)
        for value, target in zip(current, wanted, strict=True):
            assert abs(target) < 0.1 or value * target > 0.0
        assert all(23.0 < truth.battery_v <= plant.machine.battery_v for truth in truths)


@_ALL
class TestPhysics:
    def test_coasting_stops(self, nature: Nature) -> None:
        plant = _plant(nature)
        _drive(plant, 0.15, 0.0, 0.1)
        _run(plant, 2.0)
        plant.set_wheel_speeds([0.0] * plant.wheel_count)
        _run(plant, 1.5)
        truths = _run(plant, 1.0)
        assert np.hypot(truths[-1].velocity_x_m_s, truths[-1].velocity_y_m_s) < 1e-3
        assert np.allclose(_place(truths[0]), _place(truths[-1]), atol=1e-3)

    def test_without_motors_the_energy_only_falls(self, nature: Nature) -> None:
        floor = nature.draw_floor(5)
        dead = _with_machine(floor, gain_p_v_s=0.0, gain_i_v=0.0, torque_nm_a=0.0, back_emf_v_s=0.0)
        plant = _plant(nature, floor=dead)
        machine = plant.machine
        plant.body[3:6] = 0.3, -0.1, 0.5
        plant.drive.speed_rad_s[:] = np.array([5.0, -6.0, 7.0])[: plant.wheel_count]
        wheel = machine.rotor_inertia_kg_m2 * machine.gear_ratio**2
        energy_j = []
        for _ in range(1500):
            energy_j.append(
                0.5 * machine.mass_kg * float(plant.body[3] ** 2 + plant.body[4] ** 2)
                + 0.5 * machine.yaw_inertia_kg_m2 * float(plant.body[5] ** 2)
                + 0.5 * wheel * float(np.sum(plant.drive.speed_rad_s**2))
            )
            _run(plant, 0.002, 0.002)
        assert max(energy_j) == energy_j[0]
        assert energy_j[-1] < 1e-6 * energy_j[0]
        # Only what bristles, tread or pile store may come back: less than a twentieth.
        assert max(np.diff(energy_j), default=0.0) < 0.05 * energy_j[0]

    def test_in_the_air_wheels_spin_and_the_body_stays(self, nature: Nature) -> None:
        plant = _plant(nature, lifted=True)
        _drive(plant, 0.15, 0.0, 0.5)
        truth = _run(plant, 1.5)[-1]
        assert truth.wheel_speed_rad_s == pytest.approx(wheel_speeds(plant, 0.15, 0.0, 0.5), abs=0.2)
        assert np.allclose(_place(truth), 0.0, atol=1e-12)
        plant.body[3] = 0.2
        assert _run(plant, 1.0)[-1].x_m == pytest.approx(0.2, rel=1e-6)

    def test_half_the_step_changes_little(self, nature: Nature) -> None:
        ends = []
        for substeps in (4, 8):
            plant = _plant(nature, substeps=substeps)
            _drive(plant, 0.15, 0.0, 0.1)
            ends.append(_place(_run(plant, 5.0)[-1]))
        path_m = float(np.hypot(*ends[1][:2]))
        assert path_m > 0.1
        assert np.hypot(*(ends[0] - ends[1])[:2]) < 0.01 * path_m
        assert abs(ends[0][2] - ends[1][2]) < 0.01

    def test_more_resistance_more_slip(self, nature: Nature) -> None:
        floor = nature.draw_floor(7)
        floor = floor.uniform(*floor.tile_at(0.0, 0.0))
        resistance = float(floor.grid.constants[0, 0, nature.resistance])
        slips = [
            nature.steady_slip(floor.changed(nature.resistance, factor * resistance), 0.15, 0.5)
            for factor in (0.4, 1.0, 1.6)
        ]
        assert 0.0 < slips[0] * 1.05 < slips[1] < slips[2] / 1.05

    def test_truth_shows_the_slip_of_the_wheels(self, nature: Nature) -> None:
        floor = nature.draw_floor(7)
        floor = floor.uniform(*floor.tile_at(0.0, 0.0))
        plant = _plant(nature, floor=floor)
        _drive(plant, 0.15, 0.0, 0.0)
        truths = _run(plant, 3.0)[100:]
        shown = np.mean([max(truth.slip) for truth in truths])
        speed_m_s = np.mean([math.hypot(t.velocity_x_m_s, t.velocity_y_m_s) for t in truths])
        assert shown == pytest.approx(1.0 - speed_m_s / 0.15, abs=0.05)


@_OMNI
def test_rotated_by_120_degrees_all_is_the_same(nature: Nature) -> None:
    floor = nature.draw_floor(4)
    floor = _with_machine(floor.uniform(*floor.tile_at(0.0, 0.0)), com_x_m=0.0, com_y_m=0.0)
    turned = floor
    if nature.plant is CarpetPlant:
        nap_rad = float(floor.grid.constants[0, 0, carpet.NAP_RAD])
        turned = floor.changed(carpet.NAP_RAD, nap_rad + 2.0 * math.pi / 3.0)
    places = []
    for ground, turn_rad in ((floor, 0.0), (turned, 2.0 * math.pi / 3.0)):
        plant = _plant(nature, floor=ground)
        plant.phase_rad[:] = np.roll((0.1, 0.2, 0.5), 0 if turn_rad == 0.0 else 1)
        _drive(plant, 0.15 * math.cos(0.3 + turn_rad), 0.15 * math.sin(0.3 + turn_rad), 0.2)
        places.append(_place(_run(plant, 1.5)[-1]))
    cosine, sine = math.cos(2.0 * math.pi / 3.0), math.sin(2.0 * math.pi / 3.0)
    x_m, y_m, yaw_rad = places[0]
    assert math.hypot(x_m, y_m) > 0.05
    assert places[1] == pytest.approx(
        [cosine * x_m - sine * y_m, sine * x_m + cosine * y_m, yaw_rad], abs=1e-5
    )


class TestBristle:
    def test_load_goes_back_when_the_rover_speeds_up(self) -> None:
        plant = BristlePlant(
            _with_machine(bristle.draw_floor(0), com_x_m=0.0, com_y_m=0.0),
            np.random.default_rng(0),
            _START_NS,
        )
        rest = plant.load_n()
        _drive(plant, 0.4, 0.0, 0.0)
        truths, loads = [], []
        for _ in range(30):
            truths += _run(plant, 0.01, 0.01)
            loads.append(plant.load_n())
        hardest = int(np.argmin([load[0] + load[2] for load in loads]))
        assert loads[hardest][1] > rest[1] + 2.0
        assert sum(loads[hardest]) == pytest.approx(sum(rest))
        assert truths[hardest].pitch_rad < -1e-4

    def test_rows_of_rollers_make_the_rover_waver(self) -> None:
        floor = bristle.draw_floor(6)
        floor = floor.uniform(*floor.tile_at(0.0, 0.0))
        wavering = []
        for ground in (floor, floor.changed(bristle.ROW_M, 0.0)):
            plant = BristlePlant(ground, np.random.default_rng(0), _START_NS)
            _drive(plant, 0.0, 0.0, 1.0)
            wavering.append(np.std([truth.yaw_rate_rad_s for truth in _run(plant, 4.0)[50:]]))
        assert wavering[0] > 2.0 * wavering[1]

    def test_steady_friction_has_a_hump_and_stribecks_fall(self) -> None:
        ground = bristle.draw_floor(6).grid.constants[0, 0].copy()
        ground[bristle.STICTION] = 0.5
        speeds_m_s = (0.0, 0.03, ground[bristle.PEAK_M_S], 30.0)
        levels = [bristle.friction_level(ground, speed_m_s) for speed_m_s in speeds_m_s]
        assert levels[0] > levels[1] < levels[2] > levels[3]


class TestCarpet:
    def test_pile_pushes_a_rover_back_that_was_shoved_sideways(self) -> None:
        floor = carpet.draw_floor(8)
        stiffness = floor.grid.constants[:, :, carpet.STIFFNESS]
        row, column = divmod(int(stiffness.argmin()), stiffness.shape[1])
        floor = floor.uniform(row, column)
        plant = CarpetPlant(floor, np.random.default_rng(0), _START_NS)
        plant.body[4] = 0.02
        y_m = [truth.y_m for truth in _run(plant, 3.0, 0.002)]
        assert max(y_m) > 1e-4
        assert y_m[-1] < 0.8 * max(y_m)

    def test_current_is_limited_and_counted_with_ten_bits(self) -> None:
        plant = CarpetPlant(carpet.draw_floor(2), np.random.default_rng(0), _START_NS)
        limit_a = plant.machine.current_limit_a
        plant.set_wheel_speeds([60.0, -60.0, 0.0])
        currents, counts = [], []
        for _ in range(300):
            truth = _run(plant, 0.001, 0.001)[0]
            currents.append(truth.motor_current_a)
            counts.append(plant.current_counts())
        assert np.max(np.abs(currents)) == pytest.approx(limit_a)
        assert limit_a < 1.4
        most = max(max(count) for count in counts)
        assert most == pytest.approx(limit_a / 2.0 * 1023, abs=1.0)
        assert min(min(count) for count in counts) >= 0

    def test_gear_sticks(self) -> None:
        needed_a = []
        for sticking in (1.0, 1.6):
            floor = carpet.draw_floor(2).changed(carpet.GEAR_STICKING, sticking)
            # A weak loop raises the current slowly, so the current at the start of motion is seen.
            plant = CarpetPlant(
                _with_machine(floor, gain_p_v_s=0.0, gain_i_v=2.0),
                np.random.default_rng(0),
                _START_NS,
                lifted=True,
            )
            plant.set_wheel_speeds([1.0, 1.0, 1.0])
            truths = _run(plant, 2.0, 0.002)
            moving = next(k for k, truth in enumerate(truths) if truth.wheel_speed_rad_s[0] > 0.0)
            needed_a.append(truths[moving].motor_current_a[0])
        assert needed_a[1] == pytest.approx(1.6 * needed_a[0], rel=0.1)

    def test_rover_tilts_where_the_pile_is_deep_under_one_wheel(self) -> None:
        floor = carpet.draw_floor(1)
        plant = CarpetPlant(floor, np.random.default_rng(0), _START_NS)
        _drive(plant, 0.15, 0.0, 0.0)
        tilt = [(truth.roll_rad, truth.pitch_rad) for truth in _run(plant, 6.0)]
        assert 1e-4 < np.max(np.ptp(tilt, axis=0)) < 0.05


class TestFalling:
    def test_every_floor_has_all_families(self) -> None:
        for seed in range(5):
            families = np.unique(falling.draw_floor(seed).grid.constants[:, :, falling.FAMILY])
            assert families.tolist() == [falling.TYRE, falling.STRIBECK, falling.LOOSE, falling.WET]

    @pytest.mark.parametrize("family", range(4))
    def test_single_patches_go_from_rolling_to_large_slip(self, family: int) -> None:
        slips = []
        for seed in range(0, 26, 2):
            floor = falling.draw_floor(seed)
            place = np.argwhere(floor.grid.constants[:, :, falling.FAMILY] == family)[0].tolist()
            slips.append(NATURES[-1].steady_slip(floor.uniform(*place), 0.15, 0.3))
        assert 0.0 < min(slips) < 0.1
        assert 0.3 < max(slips) < 0.9

    def test_rover_slips_or_rolls_by_how_it_set_off(self) -> None:
        """Friction that falls and then rises has two steady states at one speed."""
        floor = falling.draw_floor(0).uniform(0, 0)
        for meaning, value in {
            falling.FAMILY: float(falling.WET),
            falling.STIFFNESS: 1000.0,
            falling.DAMPING: 2.2,
            falling.LENGTH_M: 0.012,
            falling.FRICTION: 0.08,
            falling.STATIC: 0.30,
            falling.FALL_M_S: 0.02,
            falling.FILM: 0.07,
            falling.DIGGING: 0.0,
            falling.RESISTANCE: 0.06,
            falling.RESISTANCE_S_M: 0.05,
            falling.ROLLER: 0.03,
        }.items():
            floor = floor.changed(meaning, value)
        ends_m_s = []
        for ramp in (1, 100):
            plant = FallingPlant(floor, np.random.default_rng(0), _START_NS)
            for part in range(1, ramp + 1):
                _drive(plant, 0.15 * part / ramp, 0.0, 0.0)
                _run(plant, 0.04)
            ends_m_s.append(np.mean([truth.velocity_x_m_s for truth in _run(plant, 4.0)[100:]]))
        assert ends_m_s[1] > 0.12
        assert ends_m_s[0] < 0.8 * ends_m_s[1]


def _differential(seed: int = 3, **values: float) -> DifferentialTreadPlant:
    floor = tread_differential.draw_floor(seed)
    floor = _with_machine(floor.uniform(*floor.tile_at(0.0, 0.0)), com_y_m=0.0, **values)
    return DifferentialTreadPlant(floor, np.random.default_rng(seed), _START_NS)


class TestDifferential:
    def test_mirrored_drive_is_the_mirror_image(self) -> None:
        places = []
        for side in (1.0, -1.0):
            plant = _differential()
            plant.tyres.swivel[0] = 0.2 * side
            _drive(plant, 0.15, 0.0, 0.4 * side)
            places.append(_place(_run(plant, 3.0)[-1]) * (1.0, side, side))
        assert places[0] == pytest.approx(places[1], abs=1e-5)
        assert places[0][2] > 0.2

    def test_castor_trails_and_flips_when_driven_backwards(self) -> None:
        plant = _differential()
        plant.tyres.swivel[0] = 0.3
        _drive(plant, 0.15, 0.0, 0.0)
        _run(plant, 3.0)
        assert abs(plant.tyres.swivel[0]) < 0.1
        plant.tyres.swivel[0] = 0.3
        _drive(plant, -0.15, 0.0, 0.0)
        _run(plant, 6.0)
        assert abs(abs(plant.tyres.swivel[0]) - math.pi) < 0.3

    def test_wheels_do_not_roll_sideways(self) -> None:
        plant = _differential()
        plant.body[4] = 0.2
        truth = _run(plant, 0.5)[-1]
        assert abs(truth.velocity_y_m_s) < 0.01
        assert abs(truth.y_m) < 0.02

    def test_turning_on_the_spot_scrubs_up_to_friction_and_rolling_eases_it(self) -> None:
        ground = tread_differential.draw_floor(3).grid.constants[0, 0]
        moments_nm = []
        for running_m_s in (0.0, 0.15):
            tyres = _differential().tyres
            for _ in range(20000):
                moment_nm = tread_differential.scrub_moment(
                    ground, 0, tyres, 45.0, 1.0, running_m_s, 1.0 / 3600.0
                )
            moments_nm.append(moment_nm)
        assert moments_nm[0] == pytest.approx(-45.0 * ground[tread.FRICTION] * 0.008)
        assert moments_nm[0] < 3.0 * moments_nm[1] < 0.0


@_ALL
class TestFloors:
    @pytest.mark.parametrize("seed", range(3))
    def test_patchwork_covers_the_mission_and_has_several_kinds(self, nature: Nature, seed: int) -> None:
        floor = nature.draw_floor(seed)
        assert 0.3 <= floor.grid.tile_m <= 0.6
        for corner in ((-1.5, -1.5), (1.5, 1.5)):
            row, column = floor.tile_at(*corner)
            assert 0 < row < floor.kind.shape[0] - 1
            assert 0 < column < floor.kind.shape[1] - 1
        first, last = floor.tile_at(-0.75, -0.75), floor.tile_at(0.75, 0.75)
        assert len(np.unique(floor.kind[first[0] : last[0] + 1, first[1] : last[1] + 1])) >= 2
        assert np.isfinite(floor.grid.constants).all()
        again = nature.draw_floor(seed)
        assert np.array_equal(floor.grid.constants, again.grid.constants)
        assert floor.machine == again.machine
        assert floor.machine != nature.draw_floor(seed + 1).machine

    def test_steady_slip_has_the_wanted_spread(self, nature: Nature) -> None:
        """A part of what `python -m tests.nature.floors` measures, so with wider limits."""
        low, middle, high = np.quantile(drive_slips(nature, 13), [0.1, 0.5, 0.9])
        assert low < 0.06
        assert 0.14 < middle < 0.28
        assert 0.40 < high < 0.60


@pytest.mark.parametrize("seed", range(5))
def test_drawn_rovers_are_plausible(seed: int) -> None:
    machine = draw_machine(np.random.default_rng(seed))
    assert 12.0 <= machine.mass_kg <= 13.0
    assert 0.0396 <= machine.radius_m <= 0.0404
    assert 0.08 <= machine.delay_s <= 0.10


def test_current_sign_follows_direction() -> None:
    signs: list[Sequence[float]] = []
    for direction in (1.0, -1.0):
        plant = _differential()
        _drive(plant, 0.15 * direction, 0.0, 0.0)
        signs.append(np.sign(np.mean([t.motor_current_a for t in _run(plant, 2.0)[50:]], axis=0)).tolist())
    assert signs == [[1.0, 1.0], [-1.0, -1.0]]
