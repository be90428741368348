"""A column of times in the table of a machine."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.gap.data.table import read_table
from sim_backends.state_model.model import StateModel
from tests.rover_hil.gap.small_machine import MODEL, small_runs, table_text

TIMED = replace(MODEL, step_s=None)


def _written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "runs.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["t_s", "time [s]", "t_s [s]"])
def test_times_are_read_under_either_name(tmp_path: Path, name: str) -> None:
    runs = read_table(TIMED, _written(tmp_path, table_text(small_runs(), time=name)))
    assert len(runs) == 4
    assert np.allclose(runs[0].inputs["t_s"], 0.1 * np.arange(60))


def test_times_need_their_unit(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="column 'time' has no unit"):
        read_table(TIMED, _written(tmp_path, table_text(small_runs(), time="time")))
    with pytest.raises(ConfigError, match="is in ms, the model has s"):
        read_table(MODEL, _written(tmp_path, table_text(small_runs(), time="time [ms]")))


def test_times_that_agree_with_the_step_of_the_model_are_no_input(tmp_path: Path) -> None:
    runs = read_table(MODEL, _written(tmp_path, table_text(small_runs(), time="time [s]")))
    assert list(runs[0].inputs) == ["power"]


def test_times_that_contradict_the_step_of_the_model_are_refused(tmp_path: Path) -> None:
    path = _written(tmp_path, table_text(small_runs(), time="time [s]", step_s=0.102))
    with pytest.raises(
        ConfigError, match=r"run run0: samples are 0\.102 s apart, the model has step_s = 0\.1"
    ):
        read_table(MODEL, path)


def test_uneven_times_are_kept_without_a_step_and_refused_with_one(tmp_path: Path) -> None:
    lines = table_text(small_runs(), time="time [s]").splitlines(keepends=True)
    lines[31] = lines[31].replace("run0,3", "run0,2.96", 1)
    path = _written(tmp_path, "".join(lines))
    times = 0.1 * np.arange(60)
    times[30] = 2.96
    assert np.allclose(read_table(TIMED, path)[0].inputs["t_s"], times)
    with pytest.raises(
        ConfigError,
        match=r"run run0: samples are 0\.06 to 0\.14 s apart, most unevenly near 2\.9\d* s: leave",
    ):
        read_table(MODEL, path)


def test_a_dropped_sample_between_uneven_times_is_a_longer_step(tmp_path: Path) -> None:
    lines = table_text(small_runs(), time="time [s]").splitlines(keepends=True)
    lines[31] = lines[31].replace("run0,3", "run0,2.96", 1)
    del lines[32]
    (run, *_) = read_table(TIMED, _written(tmp_path, "".join(lines)))
    assert np.allclose(run.inputs["t_s"][29:32], [2.9, 2.96, 3.2])
    assert np.isfinite(run.measured["reading"]).all()


@pytest.mark.parametrize(("step_s", "model"), [(0.1, TIMED), (1.0, TIMED), (0.1, MODEL)])
def test_a_dropped_sample_is_a_missing_value(tmp_path: Path, step_s: float, model: StateModel) -> None:
    lines = table_text(small_runs(), time="time [s]", step_s=step_s).splitlines(keepends=True)
    whole = read_table(model, _written(tmp_path, "".join(lines)))[0]
    del lines[31]
    (run, *_) = read_table(model, _written(tmp_path, "".join(lines)))
    (channel,) = whole.measured
    seen = np.delete(np.arange(60), 30)
    assert np.flatnonzero(np.isnan(run.measured[channel])).tolist() == [30]
    assert np.array_equal(run.measured[channel][seen], whole.measured[channel][seen])
    assert np.array_equal(run.inputs["power"][seen], whole.inputs["power"][seen])
    assert run.inputs["power"][30] == whole.inputs["power"][29]  # held
    assert run.missing == {"power": (1, 60)}
    if model.step_s is None:
        assert np.allclose(run.inputs["t_s"], step_s * np.arange(60))


def test_an_input_that_is_not_held_is_interpolated_where_samples_were_dropped(tmp_path: Path) -> None:
    lines = table_text(small_runs(), time="time [s]").splitlines(keepends=True)
    del lines[31:33]
    power = read_table(replace(TIMED, is_held=False), _written(tmp_path, "".join(lines)))[0].inputs["power"]
    assert np.allclose(np.diff(power[29:33]), (power[32] - power[29]) / 3.0)


def test_many_dropped_samples_in_a_row_are_refused(tmp_path: Path) -> None:
    lines = table_text(small_runs(), time="time [s]").splitlines(keepends=True)
    del lines[31:35]
    with pytest.raises(ConfigError, match=r"4 samples are missing after 2\.9 s, and at most 3 in a row"):
        read_table(TIMED, _written(tmp_path, "".join(lines)))


def test_rounded_times_are_even(tmp_path: Path) -> None:
    rows = table_text(small_runs(), time="time [s]", step_s=1.0).splitlines()
    cells = [row.split(",") for row in rows]
    for row in cells[1:]:
        row[1] = f"{float(row[1]) / 30.0:.2f}"
    runs = read_table(TIMED, _written(tmp_path, "\n".join(",".join(row) for row in cells)))
    steps = np.diff(runs[0].inputs["t_s"])
    assert np.ptp(steps) < 1e-12
    assert steps[0] == pytest.approx(1.0 / 30.0, rel=0.01)


def test_missing_and_falling_times_are_refused(tmp_path: Path) -> None:
    text = table_text(small_runs(), time="t_s")
    with pytest.raises(ConfigError, match="run run0: 1 of 60 times are missing"):
        read_table(TIMED, _written(tmp_path, text.replace("run0,0.5,", "run0,,", 1)))
    with pytest.raises(ConfigError, match=r"the time does not increase after 5\.9 s"):
        read_table(TIMED, _written(tmp_path, text.replace("run1,", "run0,")))
