"""Drives for the position region agree with closed forms, and their grounds with the stated priors."""

import ast
import json
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.nature.region_drives.cases import SETS, draw
from tests.nature.region_drives.grounds import (
    RELAXATION_M,
    Contact,
    Drag,
    Floor,
    Later,
    Shares,
    draw_patches,
    draw_smooth,
)
from tests.nature.region_drives.motion import DEAD_BAND_RAD_S, ROW_S, Gyro, drive
from tests.nature.region_drives.plans import SHAPES, STANDSTILL_S, STEP_S, commands
from tests.nature.region_drives.rovers import DIFFERENTIAL, OMNI, ROVERS, Rover
from tests.nature.region_drives.write import write_case

HERE = Path(__file__).parent / "region_drives"
STEADY = 200
"""Rows after which the lag of the wheels has passed."""

Array = NDArray[np.float64]


def steady(twist: tuple[float, float, float], seconds: float = 12.0) -> Array:
    return np.tile(np.array(twist), (round(seconds / STEP_S), 1))


@pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)
def test_straight_drive_with_constant_shares(rover: Rover) -> None:
    driven = drive(rover, Shares(0.3, 0.1), steady((0.5, 0.0, 0.0)))
    travel = driven.travel_m[-1]
    assert travel == pytest.approx(0.5 * (driven.t_s[-1] - 0.15), abs=0.01)
    assert driven.pose[-1] == pytest.approx([0.7 * travel, 0.1 * travel, 0.0], abs=1e-9)
    assert driven.angles[-1] * rover.radius_m @ np.cos(rover.angles) == pytest.approx(
        travel * float(np.sum(np.cos(rover.angles) ** 2)), rel=1e-9
    )


@pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)
def test_circle_keeps_its_radius_and_loses_its_rate(rover: Rover) -> None:
    driven = drive(rover, Shares(0.2), steady((0.5, 0.0, 0.4)), follows_yaw=False)
    assert driven.rate[STEADY:] == pytest.approx(0.8 * 0.4, abs=1e-6)
    first, last = driven.pose[STEADY], driven.pose[-1]
    chord = float(np.hypot(*(last - first)[:2]))
    assert chord == pytest.approx(abs(2.0 * 0.5 / 0.4 * math.sin(0.5 * (last[2] - first[2]))), abs=1e-6)


def test_two_sides_that_lose_different_shares_make_an_arc() -> None:
    driven = drive(DIFFERENTIAL, Shares(np.array((0.4, 0.1))), steady((0.5, 0.0, 0.0)), follows_yaw=False)
    assert driven.rate[STEADY:] == pytest.approx(0.5 * (0.4 - 0.1) / 0.4, abs=1e-6)
    first, last = driven.pose[STEADY], driven.pose[-1]
    radius = 0.75 * 0.5 / float(driven.rate[-1])
    chord = float(np.hypot(*(last - first)[:2]))
    assert chord == pytest.approx(abs(2.0 * radius * math.sin(0.5 * (last[2] - first[2]))), abs=1e-6)


def test_a_drag_loses_distance_and_no_rotation() -> None:
    driven = drive(OMNI, Drag(0.4), steady((0.0, 0.3, 0.3)), follows_yaw=False)
    assert driven.rate[STEADY:] == pytest.approx(driven.nominal[STEADY:, 2], abs=1e-5)
    path = np.linalg.norm(np.diff(driven.pose[STEADY:, :2], axis=0), axis=1).sum()
    assert path == pytest.approx(0.6 * (driven.travel_m[-1] - driven.travel_m[STEADY]), rel=1e-4)


def test_slip_begins_at_its_distance() -> None:
    driven = drive(DIFFERENTIAL, Later(Shares(0.0), Drag(0.5), 2.0), steady((0.5, 0.0, 0.0)))
    assert driven.pose[-1, 0] == pytest.approx(
        2.0 + 0.5 * (driven.travel_m[-1] - 2.0) + 0.5 * RELAXATION_M, abs=0.01
    )


def test_floor_loses_resistance_over_stiffness() -> None:
    floor = Floor(resistance=0.04, stiffness=8.0, radius_errors=np.zeros(3), pile=(0.0, 0.02))
    driven = drive(OMNI, floor, steady((0.5, 0.0, 0.0)))
    travel = driven.travel_m[-1] - driven.travel_m[STEADY]
    x, y, yaw = driven.pose[-1] - driven.pose[STEADY]
    assert yaw == pytest.approx(0.0, abs=1e-3)
    assert x == pytest.approx(travel * (1.0 - 0.005), rel=2e-4)
    assert y == pytest.approx(travel * 0.0025, rel=0.01)


@pytest.mark.parametrize("are_squares", [False, True])
def test_patches_have_the_stated_prior(are_squares: bool) -> None:
    rng = np.random.default_rng(4)
    pairs: list[tuple[float, float, float]] = []
    for _ in range(3000):
        patches = draw_patches(rng, 0.1, 0.02, mean=0.2, size_m=10.0, are_squares=are_squares)
        (first, side), (second, _) = patches.shares(1.0, -2.0), patches.shares(6.0, -2.0)
        pairs.append((first, second, side))
    first, second, side = np.array(pairs).T
    assert first.mean() == pytest.approx(0.2, abs=0.006)
    assert first.std() == pytest.approx(0.1, rel=0.05)
    assert side.std() == pytest.approx(0.02, rel=0.05)
    # Squares at a random rotation: a way of r stays inside with 1 - 4 r / (pi a) + r^2 / (pi a^2).
    expected = 1.0 - 2.0 / math.pi + 0.25 / math.pi if are_squares else math.exp(-0.5)
    assert float(np.corrcoef(first, second)[0, 1]) == pytest.approx(expected, abs=0.05)


def test_smooth_field_has_the_stated_prior() -> None:
    rng = np.random.default_rng(8)
    spots = np.array(((1.0, -2.0), (6.0, -2.0)))
    drawn = np.array([draw_smooth(rng, 0.1, 0.02, mean=0.2).shares(spots) for _ in range(3000)])
    lost, side = drawn[:, 0], drawn[:, 1]
    assert lost.mean() == pytest.approx(0.2, abs=0.006)
    assert lost.std() == pytest.approx(0.1, rel=0.05)
    assert side.std() == pytest.approx(0.02, rel=0.05)
    for shares in (lost, side):
        assert float(np.corrcoef(shares.T)[0, 1]) == pytest.approx(math.exp(-0.5), abs=0.05)
    assert float(np.mean(((lost - 0.2) / 0.1) ** 4)) == pytest.approx(3.0, abs=0.4)


def test_velocities_of_patches_follow_their_shares() -> None:
    patches = draw_patches(np.random.default_rng(1), 0.3, 0.1, are_squares=False)
    spots, rims = np.array(((0.0, 0.0), (30.0, 8.0))), np.array(((0.0, 2.0), (1.0, 0.0)))
    contact = Contact(
        spots=spots, rims=rims, body=rims.mean(axis=0), steps_m=np.zeros(2), acceleration=0.0, travel_m=0.0
    )
    (lost, side), (lost_far, side_far) = patches.shares(0.0, 0.0), patches.shares(30.0, 8.0)
    expected = [-2.0 * side, 2.0 * (1.0 - lost), 1.0 - lost_far, side_far]
    assert patches.velocities(contact).ravel() == pytest.approx(expected)


@pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)
@pytest.mark.parametrize("shape", SHAPES)
def test_wheels_without_slip_give_the_ground_truth(rover: Rover, shape: str) -> None:
    rng = np.random.default_rng(5)
    driven = drive(rover, Shares(0.0), commands(rover, shape, rng, 12.0))
    assert driven.travel_m[-1] == pytest.approx(12.0, rel=0.03)
    assert np.abs(driven.pose[: round(STANDSTILL_S / ROW_S)]).max() == 0.0
    assert np.abs(np.diff(driven.travel_m)).max() < 0.02
    path = np.linalg.norm(np.diff(driven.pose[:, :2], axis=0), axis=1).sum()
    assert path == pytest.approx(driven.travel_m[-1], rel=1e-3)
    assert np.cumsum(driven.nominal[:, 2])[-1] * ROW_S == pytest.approx(driven.pose[-1, 2], abs=0.01)


@pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)
def test_rate_and_yaw_belong_to_the_same_time(rover: Rover) -> None:
    driven = drive(rover, Shares(0.1), commands(rover, "rectangle", np.random.default_rng(9), 12.0))
    turned = np.cumsum(0.5 * (driven.rate[1:] + driven.rate[:-1])) * ROW_S
    assert turned == pytest.approx(driven.pose[1:, 2], abs=5e-4)


def test_gyro_has_the_noise_of_its_data_sheet() -> None:
    gyro = Gyro(walk_rad_sqrt_s=0.001)
    rng = np.random.default_rng(6)
    still = round(STANDSTILL_S / ROW_S)
    errors = []
    for _ in range(400):
        read = gyro.readings(np.zeros(still + 1000), rng)
        errors.append(float((read[still:] - read[:still].mean()).sum() * ROW_S))
    sd = float(gyro.yaw_sd_rad(np.array([1000 * ROW_S]), STANDSTILL_S)[0])
    assert float(np.std(errors)) == pytest.approx(sd, rel=0.1)


def test_dead_band_reads_zero_at_standstill_and_the_rate_in_a_rotation() -> None:
    gyro = Gyro(walk_rad_sqrt_s=0.0002, bias_sd_rad_s=0.0, has_dead_band=True)
    read = gyro.readings(np.concatenate((np.zeros(500), np.full(500, 0.3))), np.random.default_rng(7))
    assert np.mean(read[:500] == 0.0) > 0.95
    assert np.abs(read[(read != 0.0)]).min() >= DEAD_BAND_RAD_S
    assert read[500:].mean() == pytest.approx(0.3, abs=1e-3)


@pytest.mark.parametrize("name", SETS)
def test_one_seed_gives_one_drive_with_a_complete_answer(name: str, tmp_path: Path) -> None:
    for folder in ("one", "two"):
        write_case(draw(name, SETS[name][0] - 1, 3), tmp_path / folder)
    for file in ("drive.csv", "truth.csv", "answer.json", "columns.toml", "config.toml"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    answer = json.loads((tmp_path / "one" / "answer.json").read_text("utf-8"))
    assert answer["setting"]["slip"] in {"unknown", "firm", "learned"}
    assert answer["travel_m"] > 10.0
    assert len(answer["rows"]) >= 5
    if answer["contradicts"]:
        assert answer["seen_s"] > answer["begin_s"]


def test_it_imports_nothing_of_the_program() -> None:
    for path in HERE.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                assert name.split(".")[0] not in {"rover_hil", "controllers", "drivers", "sim_backends"}, path
