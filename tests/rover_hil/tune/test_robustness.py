"""Changed rovers differ from the configured one in the property that is named, and only in that."""

from pathlib import Path

import pytest

from rover_hil.config import Config, load_config
from rover_hil.tune.parameters import check_parameters, with_values
from rover_hil.tune.robustness import changed_plants, try_changed_rovers
from tests.rover_hil.tune.tuning import FakeRuns, make_config


def differences(config: Config) -> dict[str, dict[str, tuple[object, object]]]:
    plant = config.require_simulation().plant
    return {
        name: {
            key: (value, changed.model_dump()[key])
            for key, value in plant.model_dump().items()
            if value != changed.model_dump()[key]
        }
        for name, changed in changed_plants(plant).items()
    }


def test_each_change_is_the_one_that_its_name_says() -> None:
    found = differences(load_config("robotino"))
    assert list(found) == [
        "",
        "motor resistance -15 %",
        "motor resistance +15 %",
        "latency +20 ms",
        "payload +20 %",
    ]
    assert found.pop("") == {}
    assert [list(change) for change in found.values()] == [["motor"], ["motor"], ["speed_loop"], ["mass_kg"]]
    before, after = found["payload +20 %"]["mass_kg"]
    assert after == pytest.approx(1.2 * float(str(before)))
    assert list(differences(load_config("el-dorado"))) == ["", "latency +20 ms", "payload +20 %"]


def test_old_and_new_values_are_driven_on_the_same_held_out_scenarios(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    runs = FakeRuns()
    after = with_values(config, {"mission.lookahead_m": 0.1})
    rows = try_changed_rovers(config, after, check_parameters(config), runs.drive)
    assert len(rows) == 5
    assert all(row.before is not None and row.after is not None and row.after < row.before for row in rows)
    assert {seed for _, seed in runs.driven} == set(range(1001, 1007))
    unstable = with_values(config, {"mission.lookahead_m": 0.03})
    rows = try_changed_rovers(config, unstable, check_parameters(config), runs.drive)
    assert all(row.after is None for row in rows)
