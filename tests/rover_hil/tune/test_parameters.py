"""[tune]: what it may say, and how tuned values get into the text of a configuration."""

import tomllib
from pathlib import Path

import pytest

from drivers.errors import ConfigError
from rover_hil.config import Config, load_config
from rover_hil.config.tune_settings import ChangeRecord, ProvenanceRecord
from rover_hil.tune.parameters import check_parameters, rounded, start_values, unit_of, with_values
from rover_hil.tune.tuned_config import tuned_text
from tests.rover_hil.tune.tuning import TUNE, config_text, make_config

LOOKAHEAD = '"mission.lookahead_m" = { low = 0.02, high = 1.0, scale = "log", unit = "m" }'


def provenance(after: float) -> ProvenanceRecord:
    return ProvenanceRecord(
        study='a "quoted" näme',
        date="20260102-030405",
        start="rover.toml",
        trials=7,
        objective="least",
        train_seeds=(1, 4),
        held_out_seeds=(1001, 1006),
        held_out_cost_after=1e-7,
        changes={"mission.lookahead_m": ChangeRecord(before=0.5, after=after, unit="m")},
    )


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (
            '"mission.lookahed_m" = { low = 0.1, high = 1, unit = "m" }',
            "tune.parameters.mission.lookahed_m: unknown key; the configuration has speed_m_s, heading",
        ),
        ('"misson.lookahead_m" = { low = 0.1, high = 1, unit = "m" }', "has no table 'misson'"),
        (
            '"mission.lookahead_m" = { low = 0.02, high = 9, unit = "m" }',
            "tune.parameters.mission.lookahead_m: the range reaches 9, but tuned values: "
            "mission.lookahead_m: input should be less than or equal to 5, got 9.0",
        ),
        ('"mission.lookahead_m" = { low = 1, high = 0.1, unit = "m" }', "low 1 is not below high 0.1"),
        ('"mission.lookahead_m" = { low = 1, high = 1, unit = "m" }', "low 1 is not below high 1"),
        (
            '"mission.lookahead_m" = { low = 0, high = 1, scale = "log", unit = "m" }',
            "low 0 must be positive on a log scale",
        ),
        ('"mission.lookahead_m" = { low = 0.1, high = 1 }', "unit: this key is missing"),
        (
            '"mission.lookahead_m" = { low = 0.6, high = 1, unit = "m" }',
            "the current value 0.5 is outside 0.6 to 1",
        ),
        ('"mission.length_m" = { low = 0.1, high = 1, unit = "m" }', "the value changes the path"),
        ('"mission.heading" = { low = 0.1, high = 1, unit = "m" }', "is not a float; only floats"),
        ('"safety.bumper_stops" = { low = 0, high = 1, unit = "1" }', "[safety] cannot be tuned"),
        ('"simulation.plant.floor.slip" = { low = 0.01, high = 0.1, unit = "1" }', "[simulation] cannot be"),
        (
            '"mission.position_tolerance_m" = { low = 0.001, high = 0.15, unit = "m" }',
            "the range reaches 0.15, but mission: the line from",
        ),
    ],
)
def test_mistakes_are_one_sentence(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        check_parameters(make_config(tmp_path, TUNE.replace(LOOKAHEAD, line)))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_objective_names_something() -> None:
    table = tomllib.loads(config_text(TUNE.replace("path_rms_m = 0.05\nclosure_m = 0.1", "quantile = 0.9")))
    with pytest.raises(ValueError, match="has no term"):
        Config.model_validate(table)


def test_a_configuration_without_tune_mission_or_simulation_says_so(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"add \[tune.parameters\].*`tune logs`"):
        check_parameters(make_config(tmp_path, tune=""))
    with pytest.raises(ConfigError, match=r"add \[mission\]"):
        check_parameters(make_config(tmp_path, mission=""))
    config = make_config(tmp_path).model_copy(update={"simulation": None})
    with pytest.raises(ConfigError, match=r"add .*\[simulation\]"):
        check_parameters(config)


def test_values_go_in_and_come_out(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    tune = check_parameters(config)
    assert start_values(config, tune) == {"mission.lookahead_m": 0.5, "mission.heading_gain_per_s": 2.0}
    other = with_values(config, {"mission.lookahead_m": 0.25, "filter.gyro_bias_rad_s": 0.1})
    assert other.mission is not None
    assert (other.mission.lookahead_m, other.filter.gyro_bias_rad_s) == (0.25, 0.1)
    assert other.mission.speed_m_s == 0.15
    assert with_values(config, start_values(config, tune)) == config


def test_rounding_stays_within_the_range(tmp_path: Path) -> None:
    tune = check_parameters(make_config(tmp_path, TUNE.replace("low = 0.02", "low = 0.0200004")))
    assert rounded({"mission.lookahead_m": 0.02000041}, tune) == {"mission.lookahead_m": 0.0200004}
    assert rounded({"mission.heading_gain_per_s": 1.23456}, tune) == {"mission.heading_gain_per_s": 1.235}


def test_tuned_text_changes_values_and_nothing_else() -> None:
    text = config_text()
    values = {"mission.lookahead_m": 0.123, "mission.heading_gain_per_s": 4.0, "filter.gyro_bias_rad_s": 1e-5}
    tuned = tuned_text(text, values, None)
    assert "lookahead_m = 0.123    # as first guessed\n" in tuned
    lines = tuned.splitlines()
    assert set(text.splitlines()) - set(lines) == {"lookahead_m = 0.5    # as first guessed"}
    assert {line for line in set(lines) - set(text.splitlines()) if line} == {
        "lookahead_m = 0.123    # as first guessed",
        "heading_gain_per_s = 4.0",
        "[filter]",
        "gyro_bias_rad_s = 1e-05",
    }


def test_provenance_is_kept_in_the_configuration_and_replaced(tmp_path: Path) -> None:
    once = tuned_text(config_text(), {"mission.lookahead_m": 0.3}, provenance(0.3))
    twice = tuned_text(once, {"mission.lookahead_m": 0.2}, provenance(0.2))
    assert twice.count("[tune.provenance]") == 1
    path = tmp_path / "tuned.toml"
    path.write_text(twice, "utf-8")
    tune = load_config(str(path)).tune
    assert tune is not None
    assert tune.provenance == provenance(0.2)


def test_a_missing_section_is_added() -> None:
    tuned = tuned_text(config_text(mission=""), {"mission.lookahead_m": 0.2}, provenance(0.2))
    assert tomllib.loads(tuned)["mission"] == {"lookahead_m": 0.2}


@pytest.mark.parametrize(
    "text",
    [
        'mission = { type = "line", length_m = 1.0, lookahead_m = 0.5 }\n' + config_text(mission=""),
        config_text().replace("lookahead_m = 0.5", '"lookahead_m" = 0.5'),
    ],
    ids=["inline", "quoted"],
)
def test_inline_tables_and_quoted_keys_are_edited_too(text: str) -> None:
    tuned = tomllib.loads(tuned_text(text, {"mission.lookahead_m": 0.2}, provenance(0.2)))
    assert tuned["mission"] == {**tomllib.loads(text)["mission"], "lookahead_m": 0.2}
    assert tuned["tune"]["provenance"]["changes"]


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("mission.lookahead_m", "m"),
        ("mission.heading_gain_per_s", "1/s"),
        ("limits.wheel_acceleration_rad_s2", "rad/s^2"),
        ("filter.gyro_bias_rad_s", "rad/s"),
        ("filter.gyro_noise_rad_sqrt_s", ""),
        ("filter.slip_sd", ""),
        ("motor.speed_constant_v_s_per_rad", ""),
        ("mission.yaw_gain_per_m", ""),
        ("mission.gain_per_rad", "1/rad"),
    ],
)
def test_the_end_of_a_key_names_its_unit(key: str, unit: str) -> None:
    assert unit_of(key) == unit


@pytest.mark.parametrize(("unit", "is_right"), [("m", True), ("mm", False), ("1", False), ("rad", False)])
def test_another_unit_than_that_of_the_key_is_refused(tmp_path: Path, unit: str, is_right: bool) -> None:
    line = f'"mission.lookahead_m" = {{ low = 0.02, high = 1.0, unit = "{unit}" }}'
    config = make_config(tmp_path, TUNE.replace(LOOKAHEAD, line))
    if is_right:
        check_parameters(config)
        return
    with pytest.raises(
        ConfigError, match=rf"unit is '{unit}', but the key is in m: write low, high and unit"
    ):
        check_parameters(config)
