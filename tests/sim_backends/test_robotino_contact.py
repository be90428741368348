import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robotino.cells import measured_cells, simulated
from sim_backends.plants.robotino.dynamics import _contact_coefficients
from sim_backends.plants.robotino.site import Site
from sim_backends.plants.robotino.surfaces import shipped_surfaces
from tests.sim_backends.robotino_drives import OFFSET_M, RADIUS_M, ahead, drive, mean_currents, on, plant


def test_heavier_surfaces_cost_more_current_and_more_way() -> None:
    runs = [on(f"floor_{name}") for name in ("table", "brown", "gray")]
    currents = [float(np.mean(mean_currents(run, ahead(0.1)))) for run in runs]
    ways = [drive(run, ahead(0.1), 4.0).x_m for run in runs]
    assert currents[0] < 0.75 * currents[1] < 0.75 * 0.75 * currents[2]
    assert ways[0] > ways[1] > 1.1 * ways[2]


def test_slip_hardly_depends_on_speed() -> None:
    slips = [drive(on("floor_gray"), ahead(speed), 4.0).slip[2] for speed in (0.1, 0.2, 0.3)]
    assert max(slips) - min(slips) < 0.02
    assert slips[0] == pytest.approx(0.28, abs=0.04)


def test_the_rear_load_makes_it_slip_more_ahead_than_aside() -> None:
    speed = 0.2 / RADIUS_M
    forward = drive(on("floor_green"), ahead(0.2), 3.0)
    left = drive(on("floor_green"), (0.5 * speed, -speed, 0.5 * speed), 3.0)
    assert math.hypot(forward.x_m, forward.y_m) < 0.8 * math.hypot(left.x_m, left.y_m)
    assert forward.yaw_rate_rad_s == pytest.approx(0, abs=0.005)


def test_soft_red_holds_the_rover_that_goes_ahead_but_not_the_one_that_goes_aside() -> None:
    soft = {
        "floor": "red",
        "roughness": 0,
        "patches": [
            {
                "type": "circle",
                "x_m": 0,
                "y_m": 0,
                "radius_m": 1,
                "surface": "red",
                "inner": "soft",
                "sinkage_m": 0.0086,
            }
        ],
    }
    rover = on(Site.model_validate(soft), centre_of_mass_x_m=-0.0125)
    forward = drive(rover, ahead(0.2), 4.0)
    speed = 0.2 / RADIUS_M
    left = drive(rover, (0.5 * speed, -speed, 0.5 * speed), 4.0)
    assert forward.velocity_x_m_s < 0.005
    assert forward.slip[2] > 0.95
    assert left.velocity_y_m_s > 0.02


def test_a_wheel_that_carries_more_sinks_deeper_and_drags_more_per_load() -> None:
    bare = {"made": {"friction": 0.5, "stiffness": 2.0, "drag_along": 0.0, "drag_across": 0.0}}
    disc = {"type": "circle", "x_m": 0, "y_m": 0, "radius_m": 1, "surface": "made", "inner": "soft"}
    site = Site.model_validate({"floor": "made", "surfaces": bare, "patches": [disc], "roughness": 0})
    moving = plant(on(site))
    moving._state.twist[:] = (0.1, 0.0, 0.0)
    grip, along, across = np.zeros(3), np.zeros(3), np.zeros(3)
    _contact_coefficients(moving._state, moving._rover, moving._ground, grip, along, across)
    load = moving._rover.load_n
    per_load = across / load
    assert per_load[0] > 0
    assert per_load[1] / per_load[0] == pytest.approx((load[1] / load[0]) ** (1 / 3))
    assert along[0] / across[0] == pytest.approx(math.sqrt(0.052 / 0.08))


def test_one_wheel_on_another_covering_turns_the_rover() -> None:
    # The left front wheel runs on gray, the others on the table.
    site = Site.model_validate(
        {
            "roughness": 0,
            "patches": [
                {
                    "type": "rectangle",
                    "x_min_m": -1,
                    "x_max_m": 3,
                    "y_min_m": 0.05,
                    "y_max_m": 0.3,
                    "surface": "gray",
                }
            ],
        }
    )
    turned = drive(on(site), ahead(0.2), 2.0)
    assert turned.yaw_rad > 0.03
    assert turned.slip[0] > turned.slip[2] + 0.03


def test_the_wheels_carry_the_weight() -> None:
    loads = plant(on("floor_table"))._rover.load_n
    assert loads.sum() == pytest.approx(12.6 * 9.80665)
    assert loads[1] > 1.2 * loads[0] == pytest.approx(1.2 * loads[2])
    angles = np.radians((60, 180, 300))
    assert OFFSET_M * (loads @ np.cos(angles)) / loads.sum() == pytest.approx(-0.017)


@pytest.mark.slow
def test_steady_states_are_the_measured_ones(shared_data: Path) -> None:
    _, cells = measured_cells(shared_data / "robotino_2023")
    surfaces = shipped_surfaces()
    some = [cell for cell in cells if cell.direction_deg % 50 == 10]
    assert {cell.surface for cell in some} == {"table", "brown", "gray", "green"}
    good = 0
    for cell in some:
        model = simulated(cell, surfaces[cell.surface])
        speed = model.true_speed_m_s / cell.true_speed_m_s - 1
        current = model.current_a.mean() / cell.current_a.mean() - 1
        good += abs(speed) <= 0.15 and abs(current) <= 0.15
    assert good >= 0.9 * len(some)


def test_the_same_covering_resists_more_here_and_less_there() -> None:
    disc = {"type": "circle", "x_m": 0, "y_m": 0, "radius_m": 1, "surface": "gray"}
    moving = plant(on(Site.model_validate({"patches": [disc], "roughness": 0.3})))
    moving._state.twist[:] = (0.1, 0.0, 0.0)
    grip, along, across = np.zeros(3), np.zeros(3), np.zeros(3)
    felt = []
    for x_m in np.linspace(-0.8, 0.8, 100):
        moving._state.pose[0] = x_m
        _contact_coefficients(moving._state, moving._rover, moving._ground, grip, along, across)
        felt.append(across[1])
    assert 0.15 < np.std(felt) / np.mean(felt) < 0.45
