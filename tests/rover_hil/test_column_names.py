"""Tables with fixed names share the vocabulary of the file of columns; former names work once more."""

from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError, LogError
from rover_hil.drives import column_names
from rover_hil.drives.column_names import read_named_table
from rover_hil.gap.data.columns import read_columns as read_gap_columns
from rover_hil.gap.data.readers.four_wheel_drive import read_four_wheel_runs
from rover_hil.scomp.files import read_truth

FORMER = ("enc1_rad", "enc2_rad", "enc3_rad", "enc4_rad", "compass_deg", "gyro_z_deg_s", "psi_rad")
PRESENT = (
    *(f"position{wheel}_rad" for wheel in (1, 2, 3, 4)),
    "heading_deg",
    "yaw_rate_deg_s",
    "yaw_rad",
)


@pytest.fixture(autouse=True)
def _not_warned_yet() -> None:
    column_names._warn.cache_clear()


def write(path: Path, names: tuple[str, ...]) -> Path:
    t_s = np.arange(0.0, 20.0, 0.1)
    turned, none = 2.0 * t_s, np.zeros(t_s.size)
    table = np.column_stack((t_s, *(4 * (turned,)), none, none, none, 0.2 * t_s, none))
    header = ",".join(("t_s", *names, "x_m", "y_m"))
    path.write_text(header + "\n" + "\n".join(",".join(map(repr, row)) for row in table.tolist()), "utf-8")
    return path


def test_former_names_are_read_with_one_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    former, present = write(tmp_path / "former.csv", FORMER), write(tmp_path / "present.csv", PRESENT)
    assert read_gap_columns(present).keys() == read_gap_columns(former).keys()
    (run,), (other,) = read_four_wheel_runs(present), read_four_wheel_runs(former)
    for name, values in run.measured.items():
        np.testing.assert_array_equal(values, other.measured[name])
    assert read_named_table(present).names == read_named_table(former).names
    np.testing.assert_array_equal(read_truth(present).yaw_rad, read_truth(former).yaw_rad)
    warning = capsys.readouterr().err
    assert warning.count("Warning:") == 1
    for name, now in zip(FORMER, PRESENT, strict=True):
        assert f"{name} is now {now}" in warning


def test_a_column_under_both_names_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "both.csv"
    path.write_text("t_s,psi_rad,yaw_rad\n0,0,1\n1,0,1\n", "utf-8")
    with pytest.raises(ConfigError) as gap_error:
        read_gap_columns(path)
    with pytest.raises(LogError) as log_error:
        read_truth(path)
    for error in (gap_error, log_error):
        assert "'yaw_rad' and 'psi_rad', its name in the version before" in str(error.value)
