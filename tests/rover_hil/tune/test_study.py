"""The search: what it tries, what it refuses and gives up, and that nothing of it is ever lost."""

import importlib
import math
import statistics
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.config.tune_settings import ObjectiveSettings, TunableSettings
from rover_hil.tune.comparison import Verdict, compare, compare_by
from rover_hil.tune.journal import Attempt
from rover_hil.tune.objective import case_cost, describe, evaluate
from rover_hil.tune.parameters import check_parameters
from rover_hil.tune.scenarios import held_out_seeds, ranking_seeds, train_seeds
from rover_hil.tune.search import propose
from rover_hil.tune.study import CANDIDATES, MissionStudy
from tests.rover_hil.tune.tuning import (
    MISSION,
    TUNE,
    UNSTABLE_BELOW_M,
    FakeRuns,
    answer,
    lookahead_m,
    make_config,
)


class Killed(BaseException):
    """The process dies here."""


def open_study(path: Path, config: Config) -> MissionStudy:
    return MissionStudy(path, "name", config, check_parameters(config))


def search(path: Path, config: Config, trials: int, parallel_runs: FakeRuns | None = None) -> MissionStudy:
    study = open_study(path, config)
    study.search((parallel_runs or FakeRuns()).drive, trials, lambda: False, lambda: None)
    return study


def attempt_with(value_m: float, number: int = 1) -> Attempt:
    values = {"mission.lookahead_m": value_m}
    return Attempt(number=number, values=values, cost=1.0, at_least=0.0, refused="", is_start=False)


def test_the_cost_is_the_quantile_of_the_sums(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    objective = ObjectiveSettings(path_rms_m=0.02, heading_deg=0.5, quantile=0.75)
    missions = [answer(config, seed) for seed in range(5)]
    costs = [each.terms["path_rms_m"] / 0.02 + each.terms["heading_deg"] / 0.5 for each in missions]
    assert [case_cost(each, objective) for each in missions] == pytest.approx(costs)
    evaluation = evaluate(FakeRuns().drive, config, range(5), objective)
    assert evaluation.cost == pytest.approx(sorted(costs)[3])
    assert describe(objective) == "0.75 quantile over the cases of path_rms_m / 0.02 + heading_deg / 0.5"


def test_giving_up_needs_certainty_and_saves_cases(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    objective = ObjectiveSettings(path_rms_m=0.02, quantile=0.9)
    known = evaluate(FakeRuns().drive, config, range(10), objective).cost
    assert known is not None
    assert evaluate(FakeRuns().drive, config, range(10), objective, limit=known).cost == known
    parallel_runs = FakeRuns()
    given_up = evaluate(parallel_runs.drive, config, range(10), objective, limit=0.5 * known)
    assert given_up.cost is None
    assert given_up.refused == ""
    assert 0.5 * known < given_up.at_least <= known
    assert len(parallel_runs.driven) == 2


def test_the_first_trial_is_the_start_and_the_best_are_found(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    parallel_runs = FakeRuns()
    study = search(tmp_path / "study", config, 40, parallel_runs)
    attempts = study.attempts()
    assert len(attempts) == 40
    assert [attempt.is_start for attempt in attempts] == [True] + [False] * 39
    assert attempts[0].values == {"mission.lookahead_m": 0.5, "mission.heading_gain_per_s": 2.0}
    assert {seed for _, seed in parallel_runs.driven} == set(train_seeds(check_parameters(config).cases))
    candidates = study.candidates()
    costs = [attempt.cost for attempt in candidates]
    assert len(candidates) == CANDIDATES
    assert costs == sorted(costs, key=lambda cost: cost or math.inf)
    assert 0.08 < candidates[0].values["mission.lookahead_m"] < 0.125
    assert any(attempt.cost is None and not attempt.refused for attempt in attempts)


def test_unstable_gains_are_refused_at_once_whatever_their_cost(tmp_path: Path) -> None:
    config = make_config(tmp_path, TUNE.replace("high = 1.0, scale", "high = 0.6, scale"))
    parallel_runs = FakeRuns()
    study = search(tmp_path / "study", config, 25, parallel_runs)
    unstable = [each for each in study.attempts() if each.values["mission.lookahead_m"] < UNSTABLE_BELOW_M]
    assert unstable
    assert all(attempt.cost is None and attempt.refused.endswith("oscillates") for attempt in unstable)
    assert len([value for value, _ in parallel_runs.driven if value < UNSTABLE_BELOW_M]) == len(unstable)
    assert all(each.values["mission.lookahead_m"] >= UNSTABLE_BELOW_M for each in study.candidates())


def test_an_interrupted_study_goes_on_as_if_it_had_not_been(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    whole = search(tmp_path / "whole", config, 16).attempts()
    search(tmp_path / "parts", config, 5)
    search(tmp_path / "parts", config, 5)
    assert search(tmp_path / "parts", config, 16).attempts() == whole


@pytest.mark.parametrize("torn", [b"", b'{"number": 3, "values": {"half a li'])
def test_a_killed_search_loses_only_the_trial_it_was_in(tmp_path: Path, torn: bytes) -> None:
    config = make_config(tmp_path, TUNE.replace("low = 0.02", "low = 0.05"))  # rejects nothing
    path = tmp_path / "study"
    parallel_runs = FakeRuns()

    def die_in_the_fourth_trial() -> None:
        if len({value for value, _ in parallel_runs.driven}) == 4:
            raise Killed

    parallel_runs.before_case = die_in_the_fourth_trial
    with pytest.raises(Killed):
        search(path, config, 10, parallel_runs)
    with path.open("ab") as file:
        file.write(torn)
    before = open_study(path, config).attempts()
    assert len(before) == 3
    after = search(path, config, 10).attempts()
    assert after[:3] == before
    assert len(after) == 10
    assert len({attempt.values["mission.lookahead_m"] for attempt in after}) == 10


def test_the_search_stops_between_trials(tmp_path: Path) -> None:
    study = open_study(tmp_path / "study", make_config(tmp_path))
    noted: list[int] = []
    study.search(FakeRuns().drive, 10, lambda: len(noted) >= 3, lambda: noted.append(len(study.attempts())))
    assert noted == [1, 2, 3]


def test_a_study_of_another_configuration_is_refused(tmp_path: Path) -> None:
    search(tmp_path / "study", make_config(tmp_path), 2)
    with pytest.raises(ConfigError, match="begun with another configuration"):
        open_study(tmp_path / "study", make_config(tmp_path, mission=MISSION.replace("0.15", "0.16")))


def test_a_missing_search_package_is_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    monkeypatch.delitem(sys.modules, "rover_hil.tune.search")
    with pytest.raises(ConfigError, match=r"install rover-hil\[tune\]"):
        importlib.import_module("rover_hil.tune.search")


def test_a_file_that_is_no_study_is_said_so(tmp_path: Path) -> None:
    path = tmp_path / "study"
    path.write_text("a file of somebody else\n")
    with pytest.raises(ConfigError, match="no study"):
        open_study(path, make_config(tmp_path))


def test_the_best_candidate_that_survives_is_taken(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    tune = check_parameters(config)
    parallel_runs = FakeRuns()
    candidates = [attempt_with(0.03, 5), attempt_with(0.2, 8), attempt_with(0.9, 3)]
    comparison = compare(config, tune, candidates, parallel_runs.drive)
    assert comparison.verdict is Verdict.IMPROVED
    assert comparison.values == {"mission.lookahead_m": 0.2}
    assert [(attempt.number, reason[:13]) for attempt, reason in comparison.declined] == [
        (5, "scenario 3001"),
    ]
    assert {seed for _, seed in parallel_runs.driven} == {
        *held_out_seeds(tune.cases),
        *ranking_seeds(tune.cases),
    }
    assert comparison.start.cost is not None
    assert comparison.tuned.cost is not None
    assert comparison.tuned.cost < comparison.start.cost
    held_out = {value for value, seed in parallel_runs.driven if seed in held_out_seeds(tune.cases)}
    assert held_out == {0.5, 0.2}


def test_luck_in_the_search_does_not_win(tmp_path: Path) -> None:
    """The best trial of a search was lucky with its scenarios; more scenarios show it."""
    config = make_config(tmp_path)
    tune = check_parameters(config)
    lucky, good = attempt_with(0.3, 7), attempt_with(0.12, 8)
    lucky = replace(lucky, cost=0.1, case_costs=dict.fromkeys(train_seeds(tune.cases), 0.1))
    good = replace(good, cost=0.2, case_costs=dict.fromkeys(train_seeds(tune.cases), 0.2))
    assert compare(config, tune, [lucky, good], FakeRuns().drive).values == good.values


def test_what_is_not_better_on_held_out_scenarios_is_not_taken(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    parallel_runs = FakeRuns()
    worse = attempt_with(0.9, 3)
    comparison = compare(config, check_parameters(config), [worse], parallel_runs.drive)
    assert comparison.verdict is Verdict.CONFIRMED
    ((attempt, reason),) = comparison.declined
    assert (attempt.number, reason) == (3, "not better than the start on held-out cases")


def test_a_second_candidate_has_no_try_by_cost(tmp_path: Path) -> None:
    """One of several is better than the start by chance; one that is rejected gives way to the next."""
    config = make_config(tmp_path)
    tune = check_parameters(config)

    def taken(*candidates: Attempt) -> Verdict:
        drive, seeds = FakeRuns().drive, held_out_seeds(tune.cases)
        return compare_by(
            lambda values, limit: evaluate(drive, values, seeds, tune.objective, limit),
            config,
            {},
            candidates,
        ).verdict

    assert taken(attempt_with(0.9), attempt_with(0.2)) is Verdict.CONFIRMED
    assert taken(attempt_with(0.03), attempt_with(0.2)) is Verdict.IMPROVED


def test_the_start_is_kept_when_nothing_is_better(tmp_path: Path) -> None:
    config = make_config(tmp_path)
    comparison = compare(
        config, check_parameters(config), [attempt_with(0.5), attempt_with(0.9)], FakeRuns().drive
    )
    assert comparison.verdict is Verdict.CONFIRMED
    assert comparison.values["mission.lookahead_m"] == lookahead_m(config)
    assert comparison.tuned is comparison.start


def test_an_unstable_start_gives_way_to_anything_stable_and_to_nothing_else(tmp_path: Path) -> None:
    config = make_config(tmp_path, mission=MISSION.replace("lookahead_m = 0.5", "lookahead_m = 0.03"))
    tune = check_parameters(config)
    improved = compare(config, tune, [attempt_with(0.9)], FakeRuns().drive)
    assert (improved.verdict, improved.start.cost) == (Verdict.IMPROVED, None)
    none = compare(config, tune, [attempt_with(0.035)], FakeRuns().drive)
    assert (none.verdict, none.tuned.cost) == (Verdict.NONE_ACCEPTABLE, None)


def test_rejected_values_are_a_constraint_that_leads_to_acceptable_ones() -> None:
    """Without a single acceptable trial the search goes where more cases were passed."""
    parameters = {"a": TunableSettings(low=0.0, high=1.0, unit="1")}
    told = [
        Attempt(
            number=number,
            values={"a": value},
            cost=None,
            at_least=0.0,
            refused="oscillates",
            is_start=number == 0,
            case_costs=dict.fromkeys(range(round(10 * value)), 1.0),
        )
        for number, value in enumerate(np.linspace(0.0, 0.9, 40).tolist())
    ]
    proposals = [found["a"] for found in propose(parameters, {"a": 0.0}, told, 8)]
    assert statistics.median(proposals) > 0.75
