"""A column of times in the table of a machine."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.gap.data.table import read_table
from tests.rover_hil.gap_machines.small_machine import MODEL, small_runs, table_text

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


def test_uneven_times_are_refused_with_their_place(tmp_path: Path) -> None:
    lines = table_text(small_runs(), time="time [s]").splitlines(keepends=True)
    del lines[31]
    with pytest.raises(
        ConfigError, match=r"run run0: samples are 0\.1 to 0\.2 s apart, most unevenly near 2\.9 s"
    ):
        read_table(TIMED, _written(tmp_path, "".join(lines)))


def test_a_gap_is_not_taken_for_rounding(tmp_path: Path) -> None:
    lines = table_text(small_runs(), time="time [s]", step_s=1.0).splitlines(keepends=True)
    del lines[31]
    with pytest.raises(ConfigError, match="most unevenly near 29 s"):
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
