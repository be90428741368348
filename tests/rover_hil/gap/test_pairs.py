"""Two missing effects, and a third that resembles their sum."""

from collections.abc import Mapping, Sequence

import numpy as np

from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Array, Channel, EffectCard, Parameter, Run, Values, parameter

SAMPLES, STEP_S, SEED = 150, 0.1, 8


def damping(name: str, size: float) -> EffectCard:
    return EffectCard(
        name=name,
        sentence=f"The amplitude is damped: {name}.",
        place="bearing",
        parameters=(parameter("rate", "1", 0.0, size, 0.0, 10.0, "of the damping"),),
        claims=("decays",),
        experiment="swings of many amplitudes",
        source="a test",
    )


class Amplitude:
    """The amplitude of a swing, damped by powers of itself; no sensor noise is declared."""

    name = "amplitude"
    channels = (Channel(name="amplitude", unit="1"),)
    condition_units: Mapping[str, str] = {"begin": "1"}
    input_units: Mapping[str, str] = {"first": "1"}
    parameters: tuple[Parameter, ...] = ()
    effects = (damping("dry", 0.05), damping("viscous", 0.05), damping("drag", 0.05))
    step_s = STEP_S

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        dry, viscous, drag = (effects.get(card.name, {}).get("rate", 0.0) for card in self.effects)
        found = np.empty((SAMPLES, len(runs)))
        now = np.array([run.inputs["first"][0] for run in runs])
        for sample in range(SAMPLES):
            found[sample] = now
            rate = dry * np.tanh(now / 0.01) + viscous * now + drag * now * np.abs(now)
            now = now - STEP_S * rate
        return [{"amplitude": found[:, index]} for index in range(len(runs))]


def test_two_effects_are_tried_together_where_a_third_explains_most() -> None:
    rng = np.random.default_rng(SEED)
    runs = [
        Run(
            name=f"swing {number}",
            conditions={"begin": begin},
            inputs={"first": np.full(SAMPLES, begin)},
            measured={"amplitude": np.zeros(SAMPLES)},
        )
        for number, begin in enumerate(np.linspace(0.8, 1.6, 8))
    ]
    truth = Amplitude().predict(runs, {}, {"dry": {"rate": 0.02}, "drag": {"rate": 0.03}})
    measured = [
        Run(
            name=run.name,
            conditions=run.conditions,
            inputs=run.inputs,
            measured={"amplitude": one["amplitude"] + rng.normal(0.0, 0.002, SAMPLES)},
        )
        for run, one in zip(runs, truth, strict=True)
    ]
    verdict = analyse(Amplitude(), measured).verdict
    assert {one.name for one in verdict.effects} == {"dry", "drag"}, verdict.sentence
