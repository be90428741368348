"""Base parameters of a rover that imitate an effect, or contradict a name."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rover_hil.config import load_config
from rover_hil.gap.verdict import Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Array, Run, Values
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.wheels_model.model import WheelsModel

DRIVES, WINDOWS, WINDOW_S = 6, 60, 0.2
NOISE = {"forward_m_s": 0.002, "left_m_s": 0.002, "turn_rad_s": 0.004, "gyro_rad_s": 0.002}


def drives(model: WheelsModel, rng: np.random.Generator) -> list[Run]:
    """Return straight drives and arcs, forwards and backwards, as wheel speeds only."""
    found = []
    for number in range(DRIVES):
        legs = rng.uniform(0.8, 2.0, 6) * rng.choice((-1.0, 1.0), 6)
        ahead = np.repeat(legs, WINDOWS // 6)
        turning = np.repeat(rng.uniform(-0.3, 0.3, 6), WINDOWS // 6)
        smooth = np.ones(5) / 5.0
        sides = [
            np.convolve(ahead * (1.0 + sign * turning), smooth, "same").astype(np.float64)
            for sign in (-1.0, 1.0)
        ]
        inputs: dict[str, Array] = {
            f"wheel_{wheel}_rad_s": sides[wheel % 2] for wheel in range(1, model.wheel_count + 1)
        }
        t_s = WINDOW_S * np.arange(float(WINDOWS))
        found.append(
            Run(
                name=f"drive {number}",
                conditions={"speed_m_s": float(np.mean(ahead))},
                inputs={"t_s": t_s, "heading_rad": np.zeros(WINDOWS), **inputs},
            )
        )
    return found


@pytest.fixture(scope="module")
def model() -> WheelsModel:
    settings = load_config("docs/examples/differential.toml").require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    site = settings.site.model_copy(update={"floor": "gray", "roughness": 0.0, "patches": ()})
    return WheelsModel(settings.model_copy(update={"site": site}))


def verdict_on(model: WheelsModel, base: Values, effects: Mapping[str, Values]) -> Verdict:
    """Return the verdict on drives that the model itself made, with noise."""
    rng = np.random.default_rng(5)
    runs = drives(model, rng)
    measured = [
        {name: table[name] + rng.normal(0.0, sd, WINDOWS) for name, sd in NOISE.items()}
        for table in model.predict(runs, base, effects)
    ]
    return analyse(
        model, [replace(run, measured=one) for run, one in zip(runs, measured, strict=True)]
    ).verdict


@pytest.mark.slow
def test_a_resistance_of_the_ground_is_no_smaller_wheel_only(model: WheelsModel) -> None:
    """Softer ground, a base parameter, imitates it near the start: the fit must begin at a great one."""
    verdict = verdict_on(model, {}, {"rolling_resistance": {"share": 0.15}})
    assert ["rolling_resistance"] in verdict.confidence_set, verdict.sentence


@pytest.mark.slow
def test_a_base_parameter_far_from_its_nominal_value_contradicts_a_name(model: WheelsModel) -> None:
    """No effect explains a late gyro."""
    verdict = verdict_on(model, {"gyro_age_s": 0.1}, {"wheel_radius": {"error": -0.05}})
    assert verdict.verdict == "PARTLY_NAMED", verdict.sentence
    first = verdict.sentence.split(". ")[0]
    assert "gyro_age_s is " in verdict.sentence
    assert " prior deviations" in first


@pytest.mark.slow
def test_a_skidding_rover_turns_about_a_place_of_its_own_and_others_do_not(model: WheelsModel) -> None:
    """The centre moves the marker sideways in proportion to the turn."""
    assert "rotation_centre" not in {card.name for card in model.effects}
    settings = load_config("docs/examples/six_wheels.toml").require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    fixed = [wheel.model_copy(update={"steering": None}) for wheel in settings.wheels]
    skidding = WheelsModel(settings.model_copy(update={"wheels": tuple(fixed)}))
    assert "rotation_centre" in {card.name for card in skidding.effects}
    runs = drives(skidding, np.random.default_rng(3))
    before = skidding.predict(runs, {}, {})
    after = skidding.predict(runs, {}, {"rotation_centre": {"ahead_m": 0.1}})
    for one, other in zip(before, after, strict=True):
        assert other["left_m_s"] - one["left_m_s"] == pytest.approx(-0.1 * one["turn_rad_s"], abs=1e-9)
        assert other["forward_m_s"] == pytest.approx(one["forward_m_s"])


def test_a_steering_ratio_acts_as_larger_angles_do() -> None:
    settings = load_config("docs/examples/six_wheels.toml").require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    steered = WheelsModel(settings)
    assert steered.steers
    angles = {f"steering_{wheel}_rad": np.full(WINDOWS, 0.1) for wheel in range(1, steered.wheel_count + 1)}
    larger = {name: 1.2 * values for name, values in angles.items()}
    runs = drives(steered, np.random.default_rng(3))
    measured = [replace(run, inputs={**run.inputs, **angles}) for run in runs]
    turned = [replace(run, inputs={**run.inputs, **larger}) for run in runs]
    ratio = steered.predict(measured, {}, {"steering_ratio": {"error": 0.2}})
    for one, other in zip(ratio, steered.predict(turned, {}, {}), strict=True):
        assert one["turn_rad_s"] == pytest.approx(other["turn_rad_s"], abs=1e-9)
