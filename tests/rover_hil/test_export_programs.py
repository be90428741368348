"""Trajectories for evo and parameters for robot_localization, against the log that they come from."""

import json
import math
import re
import shutil
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from ruamel.yaml import YAML

from benchmarks.ros2.robot_localization import PROGRAM, replayed
from controllers.estimation.pose_estimate import YawSource
from controllers.motion.rover_geometry import OmniRoverSettings, WheelsRoverSettings
from controllers.motion.wheel_settings import WheelSettings
from rover_hil.config import load_config
from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.odometry_record import OdometryRecorder
from rover_hil.connect.records import OdometryRecord
from rover_hil.exporting.robot_localization import robot_localization_text, slip_variance_m2
from rover_hil.exporting.wheel_controller import LISTED, wheel_controller
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import ESTIMATE, ESTIMATE_SHAPE, TRUTH, TRUTH_SHAPE
from rover_hil.run.driving import run_virtual
from tests.nature.odd_drives.__main__ import write_case
from tests.nature.odd_drives.sound import SOUND
from tests.once import made_once
from tests.rover_hil.command import Command, assert_one_sentence

DRIVE_S = 14.0
CASES = {case.name: case for case in SOUND}
PARAMETERS = {
    *("frequency", "two_d_mode", "publish_tf", "map_frame", "odom_frame", "base_link_frame", "world_frame"),
    *("odom0", "odom0_config", "odom0_differential", "odom0_relative"),
    *("process_noise_covariance", "initial_estimate_covariance"),
}
"""Of robot_localization's own params/ekf.yaml."""
PLANE = [0, 1, 5, 6, 7, 11]
"""x, y, yaw and their velocities in the state of robot_localization."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = made_once(
        "robotino_moves.mcap", lambda part: run_virtual(load_config("robotino"), part, DRIVE_S, None)
    )
    return Path(shutil.copy(made, tmp_path_factory.mktemp("programs") / "run.mcap"))


def trajectory(path: Path) -> NDArray[np.float64]:
    """Return time, x, y and yaw."""
    rows = np.loadtxt(path, comments="#", ndmin=2)
    assert rows.shape[1] == 8
    assert (np.diff(rows[:, 0]) > 0.0).all()
    assert np.abs(np.linalg.norm(rows[:, 4:], axis=1) - 1.0).max() < 1e-8
    return np.column_stack((rows[:, :3], 2.0 * np.arctan2(rows[:, 6], rows[:, 7])))


def parameters(text: str) -> Any:
    yaml = YAML(typ="safe")
    yaml.version = (1, 1)  # as ROS reads it
    return yaml.load(text)


def uncommented(text: str) -> str:
    """Return the second part, the controller, as the file asks to make it."""
    lines = text[text.index("## Odometry of the wheels alone") :].splitlines()
    return "\n".join(line.removeprefix("#") for line in lines)


def test_trajectories_are_those_of_the_log(command: Command, log: Path, tmp_path: Path) -> None:
    assert command("export", str(log), "--for", "evo", "--out", str(tmp_path / "evo"), "--json") == 0
    counts = json.loads(command.out)["rows"]
    assert set(counts) == {"estimate", "odometry", "ground_truth"}
    source = LogReader(log)
    cycles = [source.parse(each, ESTIMATE_SHAPE) for each in source.messages() if each.topic == ESTIMATE]
    truths = [source.parse(each, TRUTH_SHAPE) for each in source.messages() if each.topic == TRUTH]
    last = cycles[-1]
    ends = {
        "estimate": (last["estimate"]["t_ns"], last["estimate"]),
        "odometry": (last["estimate"]["t_ns"], last["odometry"]),
        "ground_truth": (truths[-1]["t_ns"], truths[-1]),
    }
    for name, (t_ns, pose) in ends.items():
        path = tmp_path / "evo" / f"{name}.tum"
        rows = trajectory(path)
        assert len(rows) == counts[name]
        words = path.read_text().splitlines()[-1].split()
        assert int(words[0].replace(".", "")) == source.wall_offset_ns + t_ns
        assert rows[-1, 1:].tolist() == pytest.approx([pose["x_m"], pose["y_m"], pose["yaw_rad"]], abs=1e-6)


@pytest.mark.usefixtures("unrendered")
def test_evo_finds_the_error_of_the_report(command: Command, log: Path, tmp_path: Path) -> None:
    evo = pytest.importorskip("evo.core.metrics", reason="evo is not installed: its error is not compared")
    sync, files = import_module("evo.core.sync"), import_module("evo.tools.file_interface")
    assert command("export", str(log), "--for", "evo", "--out", str(tmp_path / "evo")) == 0
    assert command("replay", str(log), "--out", str(tmp_path / "page")) == 0
    summary = json.loads((tmp_path / "page" / "summary.json").read_text())
    for name, ours in (("estimate", "estimate_error"), ("odometry", "encoders_error")):
        truth = files.read_tum_trajectory_file(tmp_path / "evo" / "ground_truth.tum")
        found = files.read_tum_trajectory_file(tmp_path / "evo" / f"{name}.tum")
        truth, found = sync.associate_trajectories(truth, found)
        found.align_origin(truth)
        error = evo.APE(evo.PoseRelation.translation_part)
        error.process_data((truth, found))
        # evo compares with the nearest ground truth, the report with that at the same time.
        rms_m = error.get_statistic(evo.StatisticsType.rmse)
        assert rms_m == pytest.approx(summary[ours]["position_rms_m"], rel=0.02), name


@pytest.mark.parametrize(("case", "error_m"), [("large_gnss_half_metre", 2.0), ("large_pose_fixes", 0.05)])
def test_poses_are_in_the_frame_of_the_positions(
    command: Command, tmp_path: Path, case: str, error_m: float
) -> None:
    folder = tmp_path / "drive"
    write_case(CASES[case], folder, np.random.default_rng(1))
    path = json.loads((folder / "answer.json").read_text("utf-8"))["true_path"]
    table, columns = str(folder / "table.csv.gz"), str(folder / "columns.toml")
    assert command("import", "table", table, "--columns", columns, "--out", "drive.mcap") == 0, command.error
    Path("drive_evo").mkdir()
    Path("drive_evo/ground_truth.tum").write_text("of another log")
    assert command("export", "drive.mcap", "--for", "evo", "--force") == 0, command.error
    assert "positions of" in Path("drive_evo/estimate.tum").read_text().splitlines()[2]
    poses, odometry = (trajectory(Path(f"drive_evo/{name}.tum")) for name in ("estimate", "odometry"))
    went, way = poses[-1, 1:3] - poses[0, 1:3], np.array(path[-1][1:3]) - np.array(path[0][1:3])
    assert np.hypot(*(went - way)) < error_m
    assert abs(math.remainder(poses[0, 3] - path[0][3], math.tau)) < 0.3
    # Both begin at the same pose, and have been moved alike.
    assert odometry[0, 1:].tolist() == pytest.approx(poses[0, 1:].tolist(), abs=1e-5)
    assert not Path("drive_evo/ground_truth.tum").exists()


def test_parameters_are_settings_and_means_of_the_drive(command: Command, log: Path, tmp_path: Path) -> None:
    out = tmp_path / "ekf.yaml"
    assert command("export", str(log), "--for", "robot_localization", "--out", str(out)) == 0, command.error
    text, config = out.read_text(), load_config("robotino")
    given = parameters(text)["ekf_filter_node"]["ros__parameters"]
    assert set(given) == PARAMETERS
    assert given["odom0"] == "/odom"
    assert given["odom0_config"] == [place in (6, 7, 11) for place in range(15)]
    for name in ("process_noise_covariance", "initial_estimate_covariance"):
        assert all(isinstance(each, float) for each in given[name])  # ROS refuses whole numbers among them
        matrix = np.array(given[name]).reshape(15, 15)
        assert (matrix == np.diag(np.diag(matrix))).all()
        assert (np.diag(matrix) > 0.0).all()
    controller = parameters(uncommented(text))["omni_wheel_drive_controller"]["ros__parameters"]
    assert isinstance(config.rover, OmniRoverSettings)
    assert controller["wheel_radius"] == config.rover.wheel_radius_m
    assert controller["robot_radius"] == config.rover.base_radius_m
    assert controller["wheel_offset"] == pytest.approx(math.radians(60.0))
    diagonals = controller["diagonal_covariance"]
    assert diagonals["twist"] == pytest.approx(twist_of_wheels(log), rel=1e-3)
    assert diagonals["pose"][2:5] == [1e6, 1e6, 1e6]
    # The noise of /odom does not fit the wheels alone: theirs is stated beside them.
    assert "odom0: '/omni_wheel_drive_controller/odom'" in text
    assert controller["enable_odom_tf"] is False
    stated = re.search(r"# x and y ([\d.e+-]+), yaw ([\d.e+-]+), vx and vy [\d.e+-]+, vyaw [\d.e+-]+:", text)
    assert stated is not None
    grown = [DRIVE_S * float(each) for each in stated.groups()]
    assert grown == pytest.approx([diagonals["pose"][0], diagonals["pose"][5]], rel=0.01)
    # Each number names its source.
    for words in (
        "filter.unsure_position_noise_m_sqrt_m = 0.02",
        "setting rover.wheel_radius_m",
        "slip unknown",
        "(default)",
        "for drives of this length, speed and ground",
    ):
        assert words in text


def twist_of_wheels(path: Path) -> list[float]:
    """Return the mean variance of the velocity by the wheels alone while they turn."""
    log, config = LogReader(path), load_config("robotino")
    recorder, found, before = OdometryRecorder(config.filter, config.ground), [], None
    for message in log.messages():
        if message.topic == ESTIMATE:
            cycle = log.parse(message, ESTIMATE_SHAPE)
            odometry = tuple(cycle["odometry"].values())
            cycle["estimate"]["yaw_source"] = YawSource.WHEELS
            cycle["slip"] = None
            record = recorder.record(0, cycle)
            if record is not None:
                if before is not None and odometry != before:
                    found.append(record["velocity_variance"])
                before = odometry
    x, y, yaw = np.mean(found, axis=0).tolist()
    return [x, y, 1e6, 1e6, 1e6, yaw]


def test_the_filter_of_robot_localization_follows_odom(command: Command, log: Path, tmp_path: Path) -> None:
    out = tmp_path / "ekf.yaml"
    assert command("export", str(log), "--for", "robot_localization", "--out", str(out)) == 0, command.error
    given = parameters(out.read_text())["ekf_filter_node"]["ros__parameters"]
    records = odometry_of(log)
    states, covariances = filtered(records, given)
    source = LogReader(log)
    truth = [source.parse(each, TRUTH_SHAPE) for each in source.messages() if each.topic == TRUTH][-1]
    error = states[-1, :3] - np.array([truth["x_m"], truth["y_m"], truth["yaw_rad"]])
    sd = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    assert (np.abs(error) < 3.0 * sd[-1, :3]).all(), (error, sd[-1])
    # Its velocity is that of the messages, and no surer: their errors are alike from message to message.
    sent = np.array([velocity(each) for each in records])
    assert np.sqrt(np.mean((states[:, 3:] - sent) ** 2, axis=0)).max() < 0.006
    sent_sd = np.sqrt([each["velocity_variance"] for each in records])
    assert (np.median(sd[:, 3:] / sent_sd, axis=0) > 0.9).all()
    # Nor is the pose surer than that of /odom in the second half, or needlessly unsure in all directions.
    ours = np.array([matrix_of(each) for each in records])
    late = range(len(records) // 2 + 1, len(records))
    relative = [np.linalg.solve(ours[k, :2, :2], covariances[k, :2, :2]) for k in late]
    assert 0.95 < min(np.linalg.eigvals(each).real.min() for each in relative) < 1.1
    assert (covariances[late, 2, 2] / ours[late, 2, 2]).min() > 0.95


def odometry_of(path: Path) -> list[OdometryRecord]:
    """Return the messages of /odom of a log."""
    log, config = LogReader(path), load_config("robotino")
    recorder = OdometryRecorder(config.filter, config.ground)
    cycles = (log.parse(each, ESTIMATE_SHAPE) for each in log.messages() if each.topic == ESTIMATE)
    return [record for cycle in cycles if (record := recorder.record(0, cycle)) is not None]


def velocity(record: OdometryRecord) -> tuple[float, float, float]:
    return record["velocity_x_m_s"], record["velocity_y_m_s"], record["yaw_rate_rad_s"]


def matrix_of(record: OdometryRecord) -> NDArray[np.float64]:
    """Return the covariance of x, y and yaw."""
    return np.array(record["covariance"])[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)


def filtered(
    records: Sequence[OdometryRecord], given: Mapping[str, Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return states and covariances after each message, as robot_localization computes them on a plane.

    There is no acceleration.
    """
    noise, covariance = (
        np.array(given[name]).reshape(15, 15)[np.ix_(PLANE, PLANE)]
        for name in ("process_noise_covariance", "initial_estimate_covariance")
    )
    state, time_ns = np.zeros(6), 0
    found = []
    for record in records:
        measured, variance = np.array(velocity(record)), np.diag(record["velocity_variance"])
        if time_ns:
            step_s = (record["time_ns"] - time_ns) / 1e9
            sine, cosine = math.sin(state[2]), math.cos(state[2])
            turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
            jacobian = np.eye(6)
            jacobian[:3, 3:] = step_s * turn
            moved = step_s * turn @ state[3:]
            jacobian[0, 2], jacobian[1, 2] = -moved[1], moved[0]
            state[:3] += moved
            covariance = jacobian @ covariance @ jacobian.T + step_s * noise
            gain = covariance[:, 3:] @ np.linalg.inv(covariance[3:, 3:] + variance)
            state = state + gain @ (measured - state[3:])
            rest = np.eye(6)
            rest[:, 3:] -= gain
            covariance = rest @ covariance @ rest.T + gain @ variance @ gain.T
        else:
            state[3:], covariance[3:, 3:] = measured, variance
        time_ns = record["time_ns"]
        found.append((state.copy(), covariance.copy()))
    states, covariances = zip(*found, strict=True)
    return np.array(states), np.array(covariances)


@pytest.mark.skipif(not PROGRAM, reason="EKF_REPLAY names no program with the filter of robot_localization")
def test_the_filter_here_is_that_of_robot_localization(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "ekf.yaml"
    text = robot_localization_text(LogReader(log), load_config("robotino"), lambda: None)
    out.write_text(text)
    records = odometry_of(log)
    states, covariances = filtered(records, parameters(text)["ekf_filter_node"]["ros__parameters"])
    its_states, its_covariances = replayed(PROGRAM, out, records)
    assert np.abs(its_states[:, PLANE] - states).max() < 1e-6
    theirs = its_covariances[:, PLANE][:, :, PLANE]
    assert (np.abs(theirs - covariances) <= 1e-5 * np.abs(covariances) + 1e-8).all()


def test_names_of_frames_stay_names(log: Path) -> None:
    names = Ros2Settings(map_frame="on", odom_frame="no", base_frame="yes", namespace="off")
    config = load_config("robotino").model_copy(update={"ros2": names})
    given = parameters(robot_localization_text(LogReader(log), config, lambda: None))
    given = given["ekf_filter_node"]["ros__parameters"]
    frames = [given[f"{name}_frame"] for name in ("map", "odom", "base_link", "world")]
    assert frames == ["on", "no", "yes", "no"]
    assert given["odom0"] == "/off/odom"


def test_slip_grows_with_the_distance_then_with_its_root() -> None:
    assert slip_variance_m2(0.1, 0.3, 10.0) == pytest.approx((0.3 * 0.1) ** 2, rel=0.01)
    assert slip_variance_m2(5000.0, 0.3, 10.0) == pytest.approx(2 * 0.3**2 * 10.0 * 5000.0, rel=0.01)
    assert slip_variance_m2(0.0, 0.3, 10.0) == 0.0


def rover_of(*wheels: tuple[float, float, float]) -> WheelsRoverSettings:
    made = tuple(WheelSettings(x_m=x_m, y_m=y_m, radius_m=radius_m) for x_m, y_m, radius_m in wheels)
    return WheelsRoverSettings(kinematics="wheels", wheels=made)


def test_a_rover_with_two_sides_is_a_differential_drive() -> None:
    controller = wheel_controller(rover_of((0.0, 0.2, 0.11), (0.0, -0.3, 0.09)))
    assert controller.name == "diff_drive_controller"
    values = {each.name: each.value for each in controller.parameters}
    assert values == {
        "wheel_radius": pytest.approx(0.1),
        "left_wheel_radius_multiplier": pytest.approx(1.1),
        "right_wheel_radius_multiplier": pytest.approx(0.9),
        "wheel_separation": pytest.approx(0.5),
    }
    skids = {each.name: each.value for each in wheel_controller(load_config("el-dorado").rover).parameters}
    assert skids == {"wheel_radius": 0.092, "wheel_separation": 0.66}


def test_other_geometries_are_only_listed() -> None:
    ahead = wheel_controller(rover_of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1)))
    steers = wheel_controller(load_config("el-dorado-crab").rover)
    uneven = wheel_controller(
        OmniRoverSettings(
            kinematics="omni3", wheel_radius_m=0.04, base_radius_m=0.1, wheel_angles_deg=(50.0, 180.0, 310.0)
        )
    )
    for controller in (ahead, steers, uneven):
        assert controller.name == LISTED
        assert controller.note


@pytest.mark.parametrize("program", ["evo", "robot_localization"])
def test_a_log_without_an_estimate_gives_nothing(command: Command, tmp_path: Path, program: str) -> None:
    folder = tmp_path / "drive"
    write_case(CASES["small_plain"], folder, np.random.default_rng(1))
    table, columns = str(folder / "table.csv.gz"), str(folder / "columns.toml")
    arguments = ("import", "table", table, "--columns", columns, "--out", "drive.mcap", "--no-estimate")
    assert command(*arguments) == 0, command.error
    assert command("export", "drive.mcap", "--for", program, "--out", "made") == 2
    assert_one_sentence(command.error, "rover-hil replay drive.mcap --out FOLDER")
    assert not Path("made").exists()


@pytest.mark.parametrize("program", ["evo", "robot_localization"])
def test_files_of_programs_are_never_overwritten_unless_forced(
    command: Command, log: Path, tmp_path: Path, program: str
) -> None:
    arguments = ("export", str(log), "--for", program, "--out", str(tmp_path / "made"))
    assert command(*arguments) == 0
    assert command(*arguments) == 2
    assert_one_sentence(command.error, "--force")
    assert command(*arguments, "--force") == 0
