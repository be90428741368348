"""Noise that no sensor declares: what is learned from the runs, and what is not."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.data.table import read_table
from rover_hil.gap.fit.called_machine import called_machine
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Array, Channel, Run
from tests.nature.axis import Drive
from tests.rover_hil.gap.gap_data import axis_runs, make_axis

SLOW_RAD_S = 3.0


def drifting(runs: list[Run], size: float) -> list[Run]:
    """Return runs whose sensor wanders by a slow wave with another phase in each."""
    rng = np.random.default_rng(1)

    def wander(values: Array) -> Array:
        places = np.linspace(0.0, 5.0, values.size)
        rates = rng.uniform(0.5, 2.0, 3)
        waves = [np.sin(rate * places + rng.uniform(0.0, 6.3)) for rate in rates]
        found: Array = values + size * np.sum(waves, axis=0)
        return found

    return [replace(run, measured={name: wander(one) for name, one in run.measured.items()}) for run in runs]


@pytest.mark.parametrize(("kind", "hidden"), [("white", {}), ("correlated", {}), ("white", {"dry": 0.01})])
def test_the_noise_is_learned_beside_an_effect(kind: str, hidden: dict[str, float]) -> None:
    drive = Drive(kind=kind)
    machine = called_machine(make_axis(), axis_runs(3, drive, **hidden))
    assert machine.evidence.is_learned
    assert machine.evidence.slow == ()
    assert machine.channels[0].noise_sd == pytest.approx(drive.noise, rel=0.15)


def test_declared_noise_is_taken_as_it_is() -> None:
    model = make_axis()
    object.__setattr__(model, "channels", (replace(model.channels[0], sigma=0.123),))
    machine = called_machine(model, axis_runs(3))
    assert not machine.evidence.is_learned
    assert machine.channels[0].sigma == 0.123


def test_agreement_is_not_judged_without_sigma_where_errors_are_slow() -> None:
    """Slow errors of the sensor and of the model look the same: no answer without a declared noise."""
    runs = drifting(axis_runs(3), SLOW_RAD_S)
    verdict = analyse(make_axis(), runs, seed=3).verdict
    assert verdict.verdict is not Answer.NO_GAP
    if not verdict.effects:
        assert verdict.verdict is Answer.NOT_IDENTIFIABLE
        assert "agreement cannot be judged without sigma" in verdict.sentence


def test_a_misfit_of_many_noises_is_a_gap_where_the_noise_is_declared() -> None:
    model = make_axis()
    object.__setattr__(model, "channels", (replace(model.channels[0], sigma=Drive().noise),))
    verdict = analyse(model, drifting(axis_runs(3), SLOW_RAD_S), seed=3).verdict
    assert verdict.verdict is not Answer.NO_GAP
    assert verdict.error_budget["speed"]["sensor_noise"] == pytest.approx(Drive().noise)


def test_a_deviation_of_one_run_acts_there_only() -> None:
    machine = called_machine(make_axis(), axis_runs(3))
    problem = Problem(machine, observe(machine, axis_runs(3)))
    gain = machine.parameters[0]
    free = problem.deviations(gain, gain.prior_sd)
    columns = problem.derivatives({}, free)
    for column, item in zip(columns.T, free, strict=True):
        here = problem.rows_of(item.key)
        assert np.any(column[here])
        assert not np.any(column[~here])


class Clocked:
    """A series model whose input is called like the column of times."""

    name = "clocked"
    channels = (Channel(name="place", unit="m", sigma=0.1),)
    condition_units: Mapping[str, str] = {}
    input_units: Mapping[str, str] = {"time": "s"}
    parameters = ()
    effects = ()


def test_an_input_may_be_called_time(tmp_path: Path) -> None:
    path = tmp_path / "runs.csv"
    path.write_text("run,time [s],place [m]\n" + "".join(f"a,{n / 10},{n}\n" for n in range(40)))
    (run,) = read_table(Clocked(), path)  # type: ignore[arg-type]
    assert run.inputs["time"][:2].tolist() == [0.0, 0.1]


@pytest.mark.slow
def test_exact_data_is_no_division_by_zero() -> None:
    runs = axis_runs(3, Drive(noise=0.0), dry=0.0125)
    verdict = analyse(make_axis(), runs, seed=3).verdict
    assert any("dry_friction" in names for names in verdict.confidence_set), verdict.sentence
