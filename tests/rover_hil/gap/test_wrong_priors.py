"""A wrong base parameter among many: what is left is judged without its prior, and causes are counted."""

import math

import numpy as np
import pytest

from rover_hil.gap import Array, Channel, EffectCard, Parameter, Port, Run, RunParameter, StateModel, effects
from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Model, Values
from tests.rover_hil.gap.axis import axis_model, measured_runs


class Orifice:
    """Flow through an orifice, a number for each run."""

    name = "orifice"
    condition_units = {"pressure": "bar"}  # noqa: RUF012
    channels = (Channel(name="flow", unit="L/s", sigma=0.01),)
    parameters = (
        Parameter(name="outlet", unit="L/s/bar^0.5", nominal=0.8, prior_sd=0.04, lower=0.1, upper=5.0),
    )
    effects = tuple(
        EffectCard(
            name=name,
            sentence=sentence,
            place=place,
            parameters=(
                Parameter(name="zero", unit=unit, nominal=0.0, prior_sd=0.05, lower=-0.15, upper=0.5),
            ),
            claims=("the same at every pressure",),
            experiment="no flow",
            source="gauges",
        )
        for name, sentence, place, unit in (
            ("flow_zero", "The meter shows a flow at rest.", "meter", "L/s"),
            ("pressure_zero", "The gauge shows a pressure at rest.", "gauge", "bar"),
            ("laminar", "A part of the flow grows with the pressure.", "orifice", "L/s/bar"),
        )
    )

    def predict(
        self, runs: list[Run], parameters: Values, effects: dict[str, Values]
    ) -> list[dict[str, float]]:
        """Return a number, not an array, for each run."""
        outlet = parameters.get("outlet", 0.8)
        flow, pressure, laminar = (effects.get(card.name, {}).get("zero", 0.0) for card in self.effects)
        bars = [run.conditions["pressure"] + pressure for run in runs]
        return [{"flow": outlet * math.sqrt(bar) + laminar * bar + flow} for bar in bars]


def flows(outlet: float, zero: float = 0.0, exponent: float = 0.5, repeats: int = 1) -> list[Run]:
    """Return 24 flows by the velocity of efflux, with a scatter of 0.01 L/s."""
    rng = np.random.default_rng(10)
    found = []
    for number in range(24 * repeats):
        bar = 0.2 + 0.2 * (number // repeats)
        speed_m_s = (2.0 * 1e5 / 1000.0) ** 0.5 * bar**exponent
        litres = zero + outlet / (2.0 * 1e5 / 1000.0) ** 0.5 * speed_m_s
        found.append(
            Run(
                name=f"run{number}",
                conditions={"pressure": bar},
                measured={"flow": np.array([litres + rng.normal(0.0, 0.01)])},
            )
        )
    return found


def orifice(outlet: float, zero: float = 0.0) -> Verdict:
    model: Model = Orifice()  # type: ignore[assignment]
    return analyse(model, flows(outlet, zero)).verdict


def test_what_a_wrong_value_leaves_is_judged_without_its_prior() -> None:
    """With the prior the meter seems to have a zero error, so that there seemed to be a gap beside it."""
    verdict = orifice(1.1)
    assert (verdict.verdict, verdict.confidence_set) == (Answer.NAMED, [["outlet"]]), verdict.sentence
    assert "With this value: no gap" in verdict.sentence
    low, high = verdict.base_parameters[0].ci95
    assert low < 1.1 < high


def test_another_law_that_leaves_a_certain_error_is_not_named_for_sure() -> None:
    """A power of the pressure that no sum of the effects has; they close 99.9 % of the gap."""
    model: Model = Orifice()  # type: ignore[assignment]
    verdict = analyse(model, flows(0.8, exponent=0.7, repeats=8)).verdict
    assert verdict.verdict is Answer.PARTLY_NAMED, verdict.sentence
    assert "But a model error remains" in verdict.sentence


def test_after_a_name_the_next_steady_run_has_no_rival() -> None:
    verdict = orifice(0.8, zero=0.2)
    assert (verdict.verdict, verdict.confidence_set) == (Answer.NAMED, [["flow_zero"]]), verdict.sentence
    assert "distinguishes" not in verdict.next_run


def test_after_a_name_a_machine_needs_no_next_run() -> None:
    analysis = analyse(axis_model(), measured_runs(dry=2.5))
    assert analysis.verdict.verdict is Answer.NAMED, analysis.verdict.sentence
    assert (analysis.proposal, analysis.verdict.next_run) == (None, "")


def turned(inertia: float) -> list[Run]:
    """Return runs of J dw/dt = 0.085 u - 0.02 w, in closed form between the steps of the voltage."""
    rng = np.random.default_rng(4)
    keep = math.exp(-0.04 * 0.02 / inertia)
    runs = []
    for number in range(8):
        volts = np.repeat(rng.uniform(-6.0, 6.0, 6), 20)
        speed, speeds = float(rng.normal(0.0, 2.0)), []
        for volt in volts:
            speeds.append(speed + rng.normal(0.0, 0.05))
            speed = keep * speed + (1.0 - keep) * 0.085 * float(volt) / 0.02
        runs.append(
            Run(
                name=f"run{number}",
                conditions={},
                inputs={"voltage": volts},
                measured={"speed_sensor": np.array(speeds)},
            )
        )
    return runs


def turning() -> StateModel:
    """Return a model whose equations determine ratios: a wrong inertia, or both of the others."""

    def rate(x: Array, u: Array, p: Array, port: object) -> dict[str, Array]:
        torque = p.per_volt * u.voltage - p.damping * x.speed  # type: ignore[attr-defined]
        return {"speed": port("torque", torque) / p.inertia}  # type: ignore[attr-defined, operator]

    def parameter(name: str, unit: str, nominal: float, prior_sd: float) -> Parameter:
        return Parameter(
            name=name, unit=unit, nominal=nominal, prior_sd=prior_sd, lower=nominal / 9.0, upper=9.0 * nominal
        )

    return StateModel(
        name="turning",
        states={"speed": "rad/s"},
        inputs={"voltage": "V"},
        step_s=0.04,
        derivative=rate,  # type: ignore[arg-type]
        start=lambda p, u: {"speed": p.first},
        output=lambda x, u, p, port: {"speed_sensor": x.speed},
        channels=(Channel(name="speed_sensor", unit="rad/s", sigma=0.05),),
        parameters=(
            parameter("per_volt", "N m/V", 0.085, 0.001),
            parameter("damping", "N m s/rad", 0.02, 0.0003),
            parameter("inertia", "kg m^2", 0.005, 0.0003),
        ),
        run_parameters=(RunParameter(name="first", unit="rad/s", prior_sd=0.06, channel="speed_sensor"),),
        ports=(Port(name="torque", unit="N m", force_sd=0.01),),
        port_effects=(effects.quadratic_drag("torque", velocity="speed", size=0.0005),),
    )


@pytest.mark.slow
def test_two_wrong_values_do_not_replace_one() -> None:
    """Voltage and damping, both halved, turn the axis as twice the inertia does."""
    verdict = analyse(turning(), turned(0.01)).verdict
    assert (verdict.verdict, verdict.confidence_set) == (Answer.NAMED, [["inertia"]]), verdict.sentence
    inertia = next(one for one in verdict.base_parameters if one.name == "inertia")
    assert inertia.ci95[0] < 0.01 < inertia.ci95[1]
