"""Whole virtual runs with an overhead camera: fixes shrink the true error, and a replay is exact."""

import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from controllers.safety import Mode
from rover_hil.config import Config, load_config
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import End
from tests.rover_hil.test_virtual_run import records, replay_file

FIRST_M = 0.01
CAMERA = {
    "type": "overhead_camera",
    "source": "live_folder",
    "path": "frames",
    "frame_rate_hz": 0.5,
    "max_age_s": 6.0,
    "marker_id": 7,
    "marker_size_m": 0.12,
    "marker_height_m": 0.22,
    "calibration": "simulated",
}


def config_with(**roles: object) -> Config:
    table = load_config("robotino").model_dump(by_alias=True)
    table["safety"]["settle_s"] = 2.5
    table["devices"]["overhead"] = dict(CAMERA)
    table["roles"].update({"fixes": ["overhead"], **roles})
    return Config.model_validate(table)


def errors_and_nees(path: Path, key: str = "estimate") -> tuple[float, float]:
    """Return the rms of a position's true error in m, and the mean NEES of x, y and yaw."""
    truth = np.array(
        [
            [float(str(record[key])) for key in ("t_ns", "x_m", "y_m", "yaw_rad")]
            for record in records(path, "/truth")
        ]
    )
    squares, nees = [], []
    for record in records(path, "/estimate"):
        newest, estimate = record["estimate"], record[key]
        assert isinstance(estimate, dict)
        assert isinstance(newest, dict)
        # At the start the pose is certain by definition, and the wheels are read a little late.
        if math.hypot(estimate["x_m"], estimate["y_m"]) < FIRST_M:
            continue
        t_ns = float(newest["t_ns"])
        x_m, y_m = (float(np.interp(t_ns, truth[:, 0], truth[:, column])) for column in (1, 2))
        yaw_rad = float(np.interp(t_ns, truth[:, 0], np.unwrap(truth[:, 3])))
        error = np.array(
            [
                estimate["x_m"] - x_m,
                estimate["y_m"] - y_m,
                math.remainder(estimate["yaw_rad"] - yaw_rad, math.tau),
            ]
        )
        xx, xy, xw, yy, yw, ww = estimate["covariance"]
        nees.append(error @ np.linalg.solve(np.array([[xx, xy, xw], [xy, yy, yw], [xw, yw, ww]]), error))
        squares.append(error[0] ** 2 + error[1] ** 2)
    return math.sqrt(float(np.mean(squares))), float(np.mean(nees))


def largest_jump_m(path: Path, key: str) -> float:
    """Return the largest change of a position between two cycles."""
    poses = [record[key] for record in records(path, "/estimate")]
    places = np.array([(each["x_m"], each["y_m"]) for each in poses])  # type: ignore[index]
    return float(np.max(np.hypot(*np.diff(places, axis=0).T)))


@pytest.mark.slow
def test_a_fix_every_two_seconds_shrinks_the_true_error_and_the_covariance_is_honest(tmp_path: Path) -> None:
    path, blind_path = tmp_path / "run.mcap", tmp_path / "blind.mcap"
    assert run_virtual(config_with(), path, 60.0, None).end is End.FINISHED
    run_virtual(config_with(fixes=[]), blind_path, 60.0, None)
    error_m, nees = errors_and_nees(path)
    blind_error_m, _ = errors_and_nees(blind_path)
    assert error_m < 0.045  # 21 to 37 mm over eight seeds of the simulation
    assert blind_error_m > 1.5 * error_m
    # Three degrees of freedom; the noise of the position allows for worse ground than this.
    assert 0.1 < nees < 3.0
    innovations = [i for record in records(path, "/estimate") for i in record["innovations"]]  # type: ignore[attr-defined]
    # Dead reckoning is as good as without a camera, says so, and never jumps; the estimate does.
    reckoned_error_m, reckoned_nees = errors_and_nees(path, "dead_reckoned")
    assert reckoned_error_m > 2 * error_m
    assert 0.05 < reckoned_nees < 3.0
    jump_m = {key: largest_jump_m(path, key) for key in ("estimate", "dead_reckoned")}
    assert jump_m["dead_reckoned"] < 0.02 * 0.4
    assert jump_m["estimate"] > 2 * jump_m["dead_reckoned"]
    named = [i for i in innovations if i["name"].startswith("overhead")]
    assert len(named) > 40
    assert all(i["accepted"] for i in named)


def test_a_replay_with_fixes_is_exact(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    result = run_virtual(config_with(), path, 8.0, None)
    replayed = replay_file(path)
    assert replayed.cycles == result.cycles
    assert replayed.differences == []
    assert any("PoseFixSample" in record for record in records(path, "/samples"))


@pytest.mark.parametrize("required", [True, False])
def test_a_lost_camera_stops_the_rover_only_where_fixes_are_required(required: bool, tmp_path: Path) -> None:
    table = config_with(require_fixes=required).model_dump(by_alias=True)
    fault = {"type": "unplug", "device": "overhead", "start_s": 4.0, "duration_s": 30.0}
    table["simulation"]["faults"] = [fault]
    path = tmp_path / "run.mcap"
    run_virtual(Config.model_validate(table), path, 6.0, None)
    (*_, last) = records(path, "/estimate")
    assert last["mode"] == (Mode.SAFE_STOP if required else Mode.RUNNING)


@pytest.mark.parametrize(
    ("roles", "words"),
    [
        ({"fixes": ["nobody"]}, r"roles.fixes: \[devices\] has no 'nobody'"),
        (
            {"fixes": ["imu"]},
            "device 'imu' is neither an overhead_camera nor an nmea_gnss: name one of overhead",
        ),
        ({"headings": ["overhead"]}, "device 'overhead' is a camera and measures no heading"),
    ],
)
def test_roles_that_make_no_sense_are_refused(roles: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        config_with(**roles)
