"""Both kernels: equal to each other, and as exact as they say, against adaptive quadrature."""

import math
from pathlib import Path

import numba
import numpy as np
import pytest

from benchmarks.terrain.adaptive_wheel import AdaptiveWheel
from drivers.errors import ModelError
from sim_backends.terramechanics.slope.rover import Conditions, paper_rover
from sim_backends.terramechanics.slope.steady_state import solve_steady_state
from sim_backends.terramechanics.soil.compiled import compiled_kernel, load_compiled
from sim_backends.terramechanics.soil.library import SoilSettings, load_wheel
from sim_backends.terramechanics.soil.numpy_kernel import numpy_kernel
from sim_backends.terramechanics.soil.quadrature import TIERS, rule_for
from sim_backends.terramechanics.soil.slip import speed_ratio
from sim_backends.terramechanics.soil.wheel_contact import Kernel, wheel_contact
from tests.sim_backends.wheel_cases import SAND, random_motion, random_soil

WHEEL = load_wheel("paper_001")
KERNELS: list[Kernel] = [numpy_kernel, compiled_kernel]
LOAM = SAND.model_copy(
    update={
        "cohesion_pa": 60.0,
        "wall_adhesion_pa": 20.0,
        "wall_friction_deg": 10.0,
        "friction_angle_deg": 34.0,
    }
)


@pytest.mark.parametrize("bound", sorted(TIERS))
@pytest.mark.parametrize("camber_deg", [0.0, 5.0, -20.0, 25.0])
@pytest.mark.parametrize("soil", [SAND, LOAM], ids=["sand", "loam"])
def test_compiled_and_numpy_give_the_same_numbers(
    bound: float, camber_deg: float, soil: SoilSettings
) -> None:
    generator = np.random.default_rng(4)
    contact = wheel_contact(
        WHEEL, soil, camber_rad=math.radians(camber_deg), cross_slope_rad=0.2, slip_sinkage_m=0.003
    )
    sinkage, slip, angle = random_motion(generator, 300, math.radians(camber_deg))
    slip[::3] *= -1.0
    angle[::10] = 0.0
    slip[::15] = 0.0
    side_speed = speed_ratio(slip) * np.tan(angle)
    rule = rule_for(bound)
    plain = numpy_kernel(contact, rule, sinkage, slip, side_speed)
    compiled = compiled_kernel(contact, rule, sinkage, slip, side_speed)
    scale = np.maximum(np.abs(plain[:, 2:3]), 1e-3)
    assert np.abs((plain - compiled) / scale).max() < 1e-10


def test_wheels_without_side_walls_need_no_second_compilation() -> None:
    with_walls, without = (
        wheel_contact(WHEEL, SAND, camber_rad=0.1, cross_slope_rad=0.1, sidewall=sidewall)
        for sidewall in (True, False)
    )
    assert numba.typeof(with_walls) == numba.typeof(without)  # type: ignore[no-untyped-call]


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("camber_deg", [0.0, 12.0])
def test_forces_are_those_of_adaptive_quadrature(kernel: Kernel, camber_deg: float) -> None:
    generator = np.random.default_rng(7)
    camber = math.radians(camber_deg)
    contact = wheel_contact(WHEEL, SAND, camber_rad=camber, cross_slope_rad=0.15)
    adaptive = AdaptiveWheel(
        WHEEL, SAND, camber_rad=camber, cross_slope_rad=0.15, tolerance=1e-10 if camber == 0.0 else 1e-8
    )
    sinkage, slip, angle = random_motion(generator, 40 if camber == 0.0 else 6, camber)
    forces = kernel(contact, rule_for(1e-8), sinkage, slip, speed_ratio(slip) * np.tan(angle))
    for row in range(sinkage.size):
        expected = adaptive.forces(sinkage[row], slip[row], angle[row])
        assert forces[row] == pytest.approx(expected, abs=2e-8 * expected[2])


@pytest.mark.parametrize("bound", sorted(TIERS))
@pytest.mark.parametrize("cambered", [False, True])
def test_errors_stay_within_the_stated_bound(bound: float, cambered: bool) -> None:
    generator = np.random.default_rng(11)
    fine = rule_for(min(TIERS))
    reference = fine._replace(
        slice_node=_nodes(24)[0],
        slice_weight=_nodes(24)[1],
        plain=0,
        reach=np.zeros(1),
        nodes=np.array([64]),
        node=1.0 - (1.0 - _nodes(64)[0][np.newaxis]) ** 2,
        weight=2.0 * (1.0 - _nodes(64)[0][np.newaxis]) * _nodes(64)[1],
    )
    for _ in range(12):
        soil = random_soil(generator)
        camber = math.radians(generator.uniform(-30.0, 30.0)) if cambered else 0.0
        contact = wheel_contact(WHEEL, soil, camber_rad=camber, sidewall=False)
        sinkage, slip, angle = random_motion(generator, 200, camber)
        side_speed = speed_ratio(slip) * np.tan(angle)
        exact = compiled_kernel(contact, reference, sinkage, slip, side_speed)
        forces = compiled_kernel(contact, rule_for(bound), sinkage, slip, side_speed)
        error = np.abs(forces - exact)[:, :3] / exact[:, 2:3]
        assert error.max() < bound


def test_skid_is_exact_to_1e_5() -> None:
    generator = np.random.default_rng(3)
    contact = wheel_contact(WHEEL, SAND)
    sinkage, slip, angle = random_motion(generator, 400, 0.0)
    slip = -slip
    side_speed = speed_ratio(slip) * np.tan(angle)
    rule = rule_for(1e-8)
    node, weight = _nodes(200)
    fine = rule._replace(
        nodes=np.array([200]),
        node=1.0 - (1.0 - node[np.newaxis]) ** 2,
        weight=2.0 * (1.0 - node[np.newaxis]) * weight,
        reach=np.zeros(1),
        plain=0,
    )
    exact = compiled_kernel(contact, fine, sinkage, slip, side_speed)
    forces = compiled_kernel(contact, rule, sinkage, slip, side_speed)
    assert (np.abs(forces - exact)[:, :3] / exact[:, 2:3]).max() < 1e-5


def test_skid_continues_slip() -> None:
    contact = wheel_contact(WHEEL, SAND)
    step = np.array([1e-7, -1e-7])
    for side_speed in (0.0, 0.01, -0.2):
        forces = numpy_kernel(contact, rule_for(1e-8), np.full(2, 0.02), step, np.full(2, side_speed))
        assert forces[0] == pytest.approx(forces[1], abs=2e-3 * forces[0, 2])


def test_a_wheel_off_the_ground_feels_nothing() -> None:
    contact = wheel_contact(WHEEL, SAND, camber_rad=0.2)
    sinkage = np.array([-0.5 * WHEEL.width_m * math.tan(0.2), -0.02])
    for kernel in KERNELS:
        forces = kernel(contact, rule_for(1e-5), sinkage, np.full(2, 0.1), np.full(2, 0.1))
        assert not forces.any()


def test_no_rule_promises_what_it_cannot_keep() -> None:
    assert rule_for(1e-4) is rule_for(1e-5)
    assert rule_for(1.0) is rule_for(1e-3)
    with pytest.raises(ModelError, match=r"bound is 1e-12, outside 1e-08 \.\. 1"):
        rule_for(1e-12)


def test_the_first_use_says_that_it_compiles(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    heard: list[str] = []
    kernel = load_compiled(heard.append)
    solve_steady_state(paper_rover(), SAND, Conditions(0.2), kernel=kernel)
    kernel(wheel_contact(WHEEL, SAND), rule_for(1e-5), *(np.full(1, 0.02) for _ in range(3)))
    heard.clear()
    load_compiled(heard.append)
    assert heard == [], "the compiled code is in the cache now"
    monkeypatch.setattr("sim_backends.terramechanics.soil.compiled.cache_folder", lambda: tmp_path)
    load_compiled(heard.append)
    assert len(heard) == 1
    assert "compiling" in heard[0]


def _nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    node, weight = np.polynomial.legendre.leggauss(count)
    return 0.5 * (node + 1.0), 0.5 * weight
