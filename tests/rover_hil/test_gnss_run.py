"""Virtual runs with a GNSS receiver: positions hold the estimate, faults are reported, replay is exact."""

import cmath
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from controllers.estimation.positions.relation import APART_SD
from controllers.safety import Mode
from rover_hil.config import Config, load_config
from rover_hil.run.driving import run_virtual
from tests.cases import first_often
from tests.rover_hil.test_overhead_run import errors_and_nees
from tests.rover_hil.test_virtual_run import records, replay_file

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "differential.toml"
Table = Mapping[str, object]


def config_with(
    disturbances: tuple[Table, ...] = (),
    *,
    plant: Table | None = None,
    require_fixes: bool = False,
    slow_time_s: float = 3.0,
) -> Config:
    """Return the differential rover on a rectangle of 6 x 4 m, with an RTK receiver."""
    table = load_config(str(EXAMPLE)).model_dump(by_alias=True)
    table["mission"] = {
        "type": "rectangle", "length_m": 6.0, "width_m": 4.0, "speed_m_s": 0.4, "heading": "along_path",
    }  # fmt: skip
    table["devices"]["gnss"] = {
        "type": "nmea_gnss", "port": "ports/gnss", "baud_rate": 38400, "max_age_s": 1.0,
        "antenna_x_m": -0.1, "antenna_y_m": 0.05,
    }  # fmt: skip
    table["roles"].update({"fixes": ["gnss"], "require_fixes": require_fixes})
    table["simulation"]["devices"]["gnss"] = {
        "type": "nmea_gnss", "disturbances": list(disturbances), "slow_time_s": slow_time_s,
    }  # fmt: skip
    table["simulation"]["plant"].update(plant or {})
    return Config.model_validate(table)


@pytest.mark.slow
@pytest.mark.parametrize("slow_time_s", first_often([30.0, 3.0]), ids=["ten times as slow", "as assumed"])
def test_positions_hold_a_rover_whose_wheels_are_larger_than_it_believes(
    slow_time_s: float, tmp_path: Path
) -> None:
    """The errors of the receiver change as slowly as `correlation_s` says, and far more slowly."""
    path = tmp_path / "run.mcap"
    config = config_with(plant={"wheel_radius_error": 0.05}, slow_time_s=slow_time_s)
    result = run_virtual(config, path, 70.0, None)
    error_m, nees = errors_and_nees(path)
    reckoned_m, _ = errors_and_nees(path, "dead_reckoned")
    assert error_m < 0.08
    assert reckoned_m > 2.0 * error_m
    assert nees < 3.0
    replayed = replay_file(path)
    assert replayed.cycles == result.cycles
    assert replayed.differences == []


@pytest.mark.slow
def test_the_axes_of_the_floor_are_found_wherever_the_rover_starts(tmp_path: Path) -> None:
    """The rover starts 70 deg from east, the true pose is in the frame of the receiver."""
    path = tmp_path / "run.mcap"
    start = {"start_x_m": 5.0, "start_y_m": -3.0, "start_yaw_deg": 70.0, "wheel_radius_error": 0.05}
    run_virtual(config_with(plant=start), path, 60.0, None)
    truths = [*records(path, "/truth")]
    t_ns = [float(str(each["t_ns"])) for each in truths]
    places = np.array([complex(float(str(each["x_m"])), float(str(each["y_m"]))) for each in truths])
    local = (places - complex(5.0, -3.0)) * cmath.rect(1.0, -math.radians(70.0))
    errors = []
    for record in records(path, "/estimate"):
        estimate = record["estimate"]
        assert isinstance(estimate, dict)
        true = np.interp(estimate["t_ns"], t_ns, local.real) + 1j * np.interp(
            estimate["t_ns"], t_ns, local.imag
        )
        errors.append(abs(complex(estimate["x_m"], estimate["y_m"]) - true))
    assert math.sqrt(np.mean(np.square(errors))) < 0.12
    fixes = [each for record in records(path, "/estimate") for each in record["innovations"]]  # type: ignore[attr-defined]
    named = [each for each in fixes if each["name"].startswith("gnss")]
    assert len(named) > 400
    assert all(each["accepted"] for each in named)


@pytest.mark.parametrize("east_m", first_often([0.2, 1.0, 20.0]))
def test_after_a_jump_the_rover_waits_until_the_places_return(east_m: float, tmp_path: Path) -> None:
    """It goes on with the estimate that it had, and as certain: the false places have not moved it."""
    step = {"type": "step", "start_s": 20.0, "duration_s": 2.0, "east_m": east_m}
    path = tmp_path / "run.mcap"
    run_virtual(config_with((step,)), path, 26.0, None)
    estimates = [*records(path, "/estimate")]
    stopped = [record for record in estimates if record["mode"] == Mode.SAFE_STOP]
    assert stopped
    assert all(str(record["reason"]).startswith("gnss: its places jumped by") for record in stopped)
    assert estimates[-1]["mode"] == Mode.RUNNING
    error_m, nees = errors_and_nees(path)
    assert error_m < 0.05
    assert nees < 3.0
    assert APART_SD * max(east_deviations_m(stopped)) > 0.9 * east_m
    assert max(east_deviations_m(estimates[-10:])) < 0.27
    replayed = replay_file(path)
    assert replayed.differences == []


def test_after_a_lasting_step_the_rover_stays_stopped_and_its_region_holds_both_places(
    tmp_path: Path,
) -> None:
    """That the new places agree with the wheels does not say that they are true."""
    step = {"type": "step", "start_s": 20.0, "duration_s": 60.0, "east_m": 1.0}
    path = tmp_path / "run.mcap"
    run_virtual(config_with((step,)), path, 26.0, None)
    estimates = [*records(path, "/estimate")]
    assert estimates[-1]["mode"] == Mode.SAFE_STOP
    assert 1.0 < APART_SD * east_deviations_m(estimates[-1:])[0] < 1.3
    error_m, nees = errors_and_nees(path)
    assert error_m < 0.05
    assert nees < 3.0


def east_deviations_m(estimates: Sequence[Mapping[str, object]]) -> list[float]:
    return [math.sqrt(record["estimate"]["covariance"][0]) for record in estimates]  # type: ignore[index]


@pytest.mark.parametrize(
    ("required", "kind"),
    [
        (True, "no_fix"),
        (False, "stale"),
        pytest.param(True, "stale", marks=pytest.mark.nightly),
        pytest.param(False, "no_fix", marks=pytest.mark.nightly),
    ],
)
def test_a_receiver_without_positions_stops_the_rover_only_where_fixes_are_required(
    kind: str, required: bool, tmp_path: Path
) -> None:
    lost = {"type": kind, "start_s": 6.0, "duration_s": 30.0}
    path = tmp_path / "run.mcap"
    run_virtual(config_with((lost,), require_fixes=required), path, 9.0, None)
    (*_, last) = records(path, "/estimate")
    assert last["mode"] == (Mode.SAFE_STOP if required else Mode.RUNNING)
