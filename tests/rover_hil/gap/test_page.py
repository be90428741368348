"""The report page of an analysis of a machine."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rover_hil.gap import Array, StateModel
from rover_hil.gap.findings import Analysis
from rover_hil.gap.output import figures
from rover_hil.gap.output.error_source import TIME, ErrorSource, find_source, force_sources
from rover_hil.gap.output.report import report_text
from rover_hil.gap.output.series import forces, traces
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from sim_backends.state_model.sample_times import sample_times_s
from tests.rover_hil.gap.page_motor import NOISE_RAD_S, STEP_S, make_motor, measure_motor


def _without_friction() -> StateModel:
    model = make_motor()
    return model.with_effects([model.port_effects[1]])


@pytest.fixture(scope="module")
def named() -> Analysis:
    return analyse(make_motor(), measure_motor(coulomb_nm=0.2))


@pytest.fixture(scope="module")
def unnamed() -> Analysis:
    return analyse(_without_friction(), measure_motor(coulomb_nm=0.2))


@pytest.fixture(scope="module")
def agreeing() -> Analysis:
    return analyse(make_motor(), measure_motor())


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rover_hil.gap.output.report.draw_pictures", lambda _: [])


def _headings(page: str) -> list[str]:
    return re.findall("<h2>(.*?)</h2>", page)


def test_a_named_effect_fills_the_page(named: Analysis) -> None:
    page = report_text(named)
    assert "<h1>coulomb_friction is missing in the model.</h1>" in page
    assert "times the sensor noise; with coulomb_friction it is" in page
    assert named.verdict.sentence.split(" (")[0] in page
    assert _headings(page) == [
        "What shows it",
        "Error budget",
        "Missing effects and their sizes",
        "On the locked runs",
        "Measured and simulated",
        "Where the error is",
        "Unknown force",
        "Base parameters",
        "Unknowns of each run",
        "Not named, and why",
        "Detection limits",
    ]
    before_the_rest = page.split('<details class="rest">')[0]
    assert before_the_rest.count('<img class="drawn"') == 2
    assert "http:" not in page.replace("http://www.w3.org", "")
    assert "https:" not in page
    titles = re.findall('<img class="drawn" src="data:image/svg\\+xml;base64,[^"]+" alt="([^"]+)"', page)
    (locked,) = named.plan.confirm if named.plan is not None else ()
    assert f"speed in run {locked}" in titles
    assert "Error of speed by run and time, after" in titles
    assert "first_speed (rad/s)" in page
    assert "--model model.toml" in page


@pytest.mark.usefixtures("no_pictures")
def test_sizes_on_the_page_are_those_of_the_verdict(named: Analysis) -> None:
    assert named.machine is not None
    level = named.verdict.effects[0].parameters["level"]
    page = report_text(named)
    assert f"{level.ci95[0]:.3g} to {level.ci95[1]:.3g}" in page
    other = {"coulomb_friction.level": {"output_error": level.value, "random_force": 1.2345}}
    warned = replace(named.verdict, weightings=other, warnings=["level depends on the weighting"])
    page = report_text(replace(named, verdict=warned))
    assert '<td class="number alarm">1.23</td>' in page
    assert '<p class="warning">level depends on the weighting.</p>' in page


def test_a_gap_without_name_shows_the_force_and_the_drafts(unnamed: Analysis) -> None:
    assert unnamed.verdict.verdict is Answer.UNNAMED
    page = report_text(unnamed)
    assert "There is a gap, and no effect explains it." in page
    assert "Missing effects and their sizes" not in page
    assert "On the locked runs" not in page
    assert "Unknown force at torque against speed" in page
    assert str(unnamed.verdict.draft[0]["code"]).removesuffix(")").replace('"', "&#34;") in page
    assert unnamed.plan is not None
    assert f"speed in run {unnamed.plan.confirm[0]}" not in page
    assert '<td class="number alarm">+' in page


def test_the_force_is_the_missing_friction(unnamed: Analysis) -> None:
    assert unnamed.machine is not None
    shown = forces(unnamed.machine)
    assert {one.unit for one in shown} == {"N m"}
    speed = np.concatenate([one.sources["speed"] for one in shown])
    force = np.concatenate([one.force for one in shown])
    fast = np.abs(speed) > 1.0
    # The refitted viscous friction takes a part of it: the rest is the sign law about its regression.
    assert np.corrcoef(np.sign(speed[fast]), force[fast])[0, 1] < -0.9
    sd = np.concatenate([one.sd for one in shown])
    assert 0.0 < np.median(sd) < 0.1
    assert max(one.times_s[-1] for one in shown) <= 59 * STEP_S
    (sentence,) = force_sources(unnamed.machine, shown)
    assert sentence.startswith("force at torque: ")
    assert "follows speed, in 4 of 4 runs" in sentence


def test_agreement_is_green_only_with_a_small_error_budget(agreeing: Analysis) -> None:
    assert agreeing.machine is not None
    page = report_text(agreeing)
    assert "The model agrees with the runs." in page
    assert "The model error of speed is at most" in page
    assert "var(--good); color: #fff" in page
    assert "Unknown force" not in page
    large = replace(agreeing.machine.budget_before[0], upper=3.0 * NOISE_RAD_S)
    page = report_text(replace(agreeing, machine=replace(agreeing.machine, budget_before=(large,))))
    assert "var(--attention); color: #fff" in page


def test_missing_values_leave_gaps_in_the_lines() -> None:
    runs = measure_motor()
    runs[0].measured["speed"][10:13] = np.nan
    analysis = analyse(make_motor(), runs)
    assert analysis.machine is not None
    page = report_text(analysis)
    assert "Missing values" in page
    first = next(one for one in traces(analysis.machine) if one.run == "r0")
    assert np.isnan(first.measured[10:13]).all()
    assert np.isfinite(first.measured[13:]).all()


def test_times_are_seconds_since_the_start_of_the_run() -> None:
    run = measure_motor(1)[0]
    assert sample_times_s(run, STEP_S)[-1] == pytest.approx(59 * STEP_S)
    stamps = (100.0 + 0.1 * np.arange(60)).astype(np.float64)
    timed = replace(run, inputs={**run.inputs, "t_s": stamps})
    times = sample_times_s(timed, None)
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(5.9)


def test_a_map_shows_the_error_of_each_part_of_a_run(named: Analysis) -> None:
    assert named.machine is not None
    one = traces(named.machine)[0]
    step = replace(one, measured=np.zeros(60), before=np.where(np.arange(60) < 30, 0.0, 2.0), after=None)
    figure = figures.draw_map([step], is_after=False)
    assert figure is not None
    table = np.asarray(figure.axes[0].images[0].get_array())[0]
    assert table[:10] == pytest.approx(0.0)
    assert table[11:] == pytest.approx(2.0)
    assert figures.draw_map([step], is_after=True) is None


@pytest.mark.parametrize(("followers", "expected"), [(3, "speed"), (2, "speed"), (1, None), (0, None)])
def test_a_source_needs_two_runs(followers: int, expected: str | None) -> None:
    found = _find(followers, lambda speed, _: np.sign(speed))
    assert (found.source if found is not None else None) == expected
    if found is not None:
        assert found.agreeing == followers
        assert found.count == 3


def test_one_run_that_follows_a_weaker_one_is_not_enough() -> None:
    rng = np.random.default_rng(2)
    strong, weak = rng.normal(0.0, 2.0, (2, 300)).astype(np.float64)
    errors = [np.sign(strong), 0.3 * np.sign(weak) + rng.normal(0.0, 0.7, 300)]
    sources = [{"speed": strong}, {"speed": weak}]
    assert find_source("y", errors, [0.0, 0.0], sources, {"speed": "rad/s"}) is None
    again = find_source("y", [errors[0], errors[0]], [0.0, 0.0], [sources[0]] * 2, {"speed": "rad/s"})
    assert again is not None
    assert again.sentence().startswith("y: 94% of the energy above the noise follows speed, in 2 of 2 runs")


def test_an_offset_is_called_a_constant() -> None:
    found = _find(3, lambda _, times: np.full(times.size, 0.5))
    assert found is not None
    assert "above the noise is a constant, in 3 of 3 runs." in found.sentence()


def test_a_source_is_the_one_that_explains_most() -> None:
    found = _find(3, lambda _, times: np.where(times > 4.0, 1.0, 0.0))
    assert found is not None
    assert found.source == TIME
    assert found.low == pytest.approx(4.0, abs=0.6)
    assert found.high == pytest.approx(5.0, abs=0.1)
    assert found.share > 0.8


def _find(followers: int, law: Callable[[Array, Array], Array]) -> ErrorSource | None:
    """Return the source of errors that follow a law in some of three runs, and are noise in the others."""
    rng = np.random.default_rng(1)
    times: Array = np.linspace(0.0, 5.0, 300, dtype=np.float64)
    errors, sources = [], []
    for run in range(3):
        speed = rng.normal(0.0, 2.0, times.size)
        noise = rng.normal(0.0, 0.1, times.size)
        # An error that follows nothing, well above the noise.
        own = law(speed, times) if run < followers else rng.normal(0.0, 0.7, times.size)
        errors.append(own + noise)
        sources.append({"speed": speed.astype(np.float64), TIME: times})
    return find_source("y", errors, [0.01 * times.size] * 3, sources, {"speed": "rad/s", TIME: "s"})
