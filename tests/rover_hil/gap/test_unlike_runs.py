"""Runs that differ among themselves: each swing begins a little off, which no card knows of."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from numba import njit

from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Array, Channel, Run, Values, parameter
from tests.cases import first_often
from tests.nature.pendulum import G_M_S2, SAMPLE_S, SAMPLES, TruePendulum, measure_swings
from tests.rover_hil.gap.gap_models import card

RUNS, NOISE_RAD = 12, 0.005


@njit(cache=True)
def push(
    angle: float, rate: float, length: float, viscous: float, level: float, drag: float, tilt: float,
    spring: float,
) -> float:  # fmt: skip
    brake = level * math.tanh(rate / 0.01) + (viscous + drag * abs(rate)) * rate
    return -G_M_S2 / length * math.sin(angle + tilt) - spring * angle - brake


@njit(cache=True)
def swing(
    start: Array, length: float, viscous: float, level: float, drag: float, tilt: float, spring: float
) -> Array:
    angles, step = np.zeros((SAMPLES, start.size)), SAMPLE_S / 4
    for run in range(start.size):
        angle, rate = start[run], 0.0
        for index in range(SAMPLES):
            angles[index, run] = angle
            for _ in range(4):
                first = push(angle, rate, length, viscous, level, drag, tilt, spring)
                middle, middle_rate = angle + 0.5 * step * rate, rate + 0.5 * step * first
                second = push(middle, middle_rate, length, viscous, level, drag, tilt, spring)
                angle, rate = angle + step * middle_rate, rate + step * second
    return angles


class Pendulum:
    """Swings by Heun's steps of a quarter of a sample, all runs at once."""

    name = "pendulum"
    channels = (Channel(name="angle", unit="rad"),)
    condition_units: Mapping[str, str] = {"start": "rad"}
    parameters = (
        parameter("length", "m", 0.5, 0.004, 0.3, 0.8),
        parameter("viscous", "1/s", 0.05, 0.015, 0.0, 1.0),
    )
    effects = (
        card("dry_friction", "joint", parameter("level", "rad/s2", 0.0, 0.1, 0.0, 5.0)),
        card("drag", "air", parameter("share", "1/rad", 0.0, 0.05, 0.0, 2.0)),
        card("tilt", "base", parameter("angle", "rad", 0.0, 0.02, -0.3, 0.3)),
        card("spring", "cable", parameter("per_angle", "1/s2", 0.0, 0.5, 0.0, 10.0)),
        card("scale", "sensor", parameter("error", "1", 0.0, 0.02, -0.3, 0.3)),
        card("length_error", "rod", parameter("change", "m", 0.0, 0.02, -0.2, 0.2), releases="length"),
    )

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        def of(effect: str, name: str) -> float:
            return effects.get(effect, {}).get(name, 0.0)

        length = parameters.get("length", 0.5) + of("length_error", "change")
        viscous, level = parameters.get("viscous", 0.05), of("dry_friction", "level")
        drag, tilt, spring = of("drag", "share"), of("tilt", "angle"), of("spring", "per_angle")

        angle = np.array([run.conditions["start"] for run in runs])
        angles = swing(angle, length, viscous, level, drag, tilt, spring)
        angles = (1.0 + of("scale", "error")) * angles
        return [{"angle": angles[:, index]} for index in range(len(runs))]


def verdict_of(seed: int, true: TruePendulum) -> Verdict:
    rng = np.random.default_rng(seed)
    starts = np.round(rng.uniform(0.2, 1.3, RUNS) * rng.choice([-1.0, 1.0], RUNS), 4)
    runs = [
        Run(name=f"swing{index}", conditions={"start": float(start)}, measured={"angle": angle})
        for index, (start, angle) in enumerate(
            zip(starts, measure_swings(true, starts, NOISE_RAD, rng), strict=True)
        )
    ]
    return analyse(Pendulum(), runs, seed=seed).verdict


@pytest.mark.parametrize("seed", first_often([1, 5]))
def test_what_differs_from_run_to_run_gets_no_name(seed: int) -> None:
    verdict = verdict_of(seed, TruePendulum(length_m=0.503, start_error_rad=0.01))
    assert not verdict.confidence_set, verdict.sentence


@pytest.mark.parametrize(
    ("name", "true"),
    first_often(
        [
            ("dry_friction", TruePendulum(length_m=0.498, start_error_rad=0.003, dry_rad_s2=0.1)),
            ("drag", TruePendulum(length_m=0.498, start_error_rad=0.003, drag_per_rad=0.04)),
            ("tilt", TruePendulum(length_m=0.498, start_error_rad=0.003, tilt_rad=0.02)),
            ("length_error", TruePendulum(length_m=0.53, start_error_rad=0.003)),
        ]
    ),
)
def test_an_effect_that_all_runs_share_is_named_alone(name: str, true: TruePendulum) -> None:
    verdict = verdict_of(4, true)
    assert [list(names) for names in verdict.confidence_set] == [[name]], verdict.sentence


@pytest.mark.parametrize("seed", [6])
def test_a_law_that_no_card_has_is_seen_and_gets_no_sure_name(seed: int) -> None:
    """A hardening spring is nearly a longer rod with a strong spring beside it."""
    verdict = verdict_of(seed, TruePendulum(stiffening_per_s2=0.8, start_error_rad=0.003))
    assert verdict.verdict in (Answer.UNNAMED, Answer.PARTLY_NAMED), verdict.sentence
