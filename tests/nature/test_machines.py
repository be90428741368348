"""Cases: what they contain, and that they repeat."""

from pathlib import Path

import numpy as np
import pytest

from tests.nature import machines
from tests.nature.machines import FAMILIES, make_case
from tests.nature.machines.case import KINDS
from tests.nature.machines.make import EXTRA_SCATTER, SHARES, draw_machine, kind_of
from tests.nature.machines.tables import family_tables

pytestmark = pytest.mark.nightly  # a truth generator, which no change of the program touches

FOLDER = Path(machines.__file__).parent
README = (FOLDER / "README.md").read_text("utf-8")


def _number(family: str, kind: str) -> int:
    return next(number for number in range(200) if kind_of(family, number) == kind)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_readme_has_the_tables_of_the_code(family: str) -> None:
    assert family_tables(FAMILIES[family]) in README


@pytest.mark.parametrize("family", FAMILIES)
def test_the_same_number_gives_the_same_case(family: str) -> None:
    first, again, other = (make_case(family, number) for number in (3, 3, 4))
    for run, same in zip(first.runs, again.runs, strict=True):
        for name, values in run.measured.items():
            assert np.array_equal(values, same.measured[name])
    channel = FAMILIES[family].channels[0].name
    assert not np.array_equal(first.runs[0].measured[channel][:100], other.runs[0].measured[channel][:100])


def test_nothing_here_imports_the_product() -> None:
    for path in FOLDER.glob("*.py"):
        text = path.read_text("utf-8")
        assert "import rover_hil" not in text, path
        assert "from rover_hil" not in text, path
        assert "sim_backends" not in text, path


def test_kinds_come_in_their_shares() -> None:
    kinds = [kind_of(family, number) for family in FAMILIES for number in range(400)]
    for kind in KINDS:
        assert kinds.count(kind) / len(kinds) == pytest.approx(SHARES[kind], abs=0.03)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("kind", KINDS)
def test_a_case_is_labelled_by_its_kind(family: str, kind: str) -> None:
    case = make_case(family, _number(family, kind))
    known = {effect.name for effect in FAMILIES[family].catalogue}
    foreign = {term.name for term in FAMILIES[family].outside}
    named = set(case.effects)
    expected = {"single": 1, "pair": 2, "outside": 1}.get(kind, 0)
    assert case.kind == kind
    assert len(named) == expected
    assert named <= (foreign if kind == "outside" else known)
    assert {term.name for term in case.terms} == named & foreign
    assert (case.disturbance_rms > 0.0) is (kind == "broad")
    assert (case.snr > 0.0) is (kind != "none")
    assert case.snr_after_refit <= case.snr * 1.001


@pytest.mark.parametrize("family", FAMILIES)
def test_runs_are_as_documented(family: str) -> None:
    chosen = FAMILIES[family]
    for number in range(6):
        case = make_case(family, number)
        assert 4 <= len(case.runs) <= 12
        for run in case.runs:
            for signal in chosen.inputs:
                assert 200 <= run.inputs[signal.name].size <= 400
                assert run.inputs[signal.name].min() >= signal.low
                assert run.inputs[signal.name].max() <= signal.high
            for state in chosen.states:
                asked = run.conditions[f"start_{state.name}"]
                assert abs(run.initial_state[state.name] - asked) <= 2.0 * state.spread + 1e-12
                assert run.truth[state.name][0] == pytest.approx(run.initial_state[state.name])


@pytest.mark.parametrize("family", FAMILIES)
def test_measured_is_truth_with_noise_and_quantum(family: str) -> None:
    case = make_case(family, 0)
    for name, sigma in case.sigma.items():
        quantum = case.quantum[name]
        measured = np.concatenate([run.measured[name] for run in case.runs])
        errors = measured - np.concatenate([run.truth[name] for run in case.runs])
        expected = np.hypot(sigma, quantum / np.sqrt(12.0))
        assert errors.std() == pytest.approx(expected, rel=0.1)
        assert abs(errors.mean()) < 5.0 * expected / np.sqrt(errors.size)
        assert measured / quantum == pytest.approx(np.round(measured / quantum), abs=1e-6)


@pytest.mark.parametrize("factor", [1.0, EXTRA_SCATTER])
def test_parameters_scatter_from_run_to_run_as_documented(factor: float) -> None:
    ratios: list[float] = []
    for family in FAMILIES.values():
        for seed in range(30):
            machine = draw_machine(family, factor, np.random.default_rng(seed))
            for one in family.parameters:
                if one.scatter > 0.0:
                    true = machine.parameters[one.name]
                    ratios += [(run[one.name] / true - 1.0) / one.scatter for run in machine.run_parameters]
    # A normal number cut off at two has a standard deviation of 0.96.
    assert np.std(ratios) == pytest.approx(0.96 * factor, rel=0.05)


def test_extra_scatter_comes_in_cases_without_effects_only() -> None:
    extra = [make_case("thermal", number) for number in range(50)]
    assert {case.kind for case in extra if case.extra_scatter} == {"none"}
    none = [case for case in extra if case.kind == "none"]
    assert 0.05 < np.mean([case.extra_scatter for case in none]) < 0.4
