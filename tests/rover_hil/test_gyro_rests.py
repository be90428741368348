"""The bias of a gyro by the rests of a drive: used where it differs from zero, and with its deviation."""

import gzip
import math
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from controllers.estimation.settings import FilterSettings
from rover_hil.drives.formats.table.gyro_rests import GyroRest, learn_bias
from rover_hil.recording.reader import LogReader
from tests.cases import first_often
from tests.rover_hil.command import Command

SEED = 35
COLUMNS = """rate_hz = 20
time = { column = "t" }
[increments]
distance = { column = "distance" }
turn = { column = "turn" }
turn_by_gyro = true
[rover]
kinematics = "wheels"
wheels = [{ x_m = 0.0, y_m = 0.25, radius_m = 0.1 }, { x_m = 0.0, y_m = -0.25, radius_m = 0.1 }]
[limits]
wheel_speed_rad_s = 60
wheel_acceleration_rad_s2 = 500
"""
TRUTH = """[truth]
file = "truth.csv.gz"
x = { column = "x" }
y = { column = "y" }
yaw = { column = "yaw" }
"""


def rest(t_s: float, mean_rad_s: float, readings: int, noise: float = 2e-3) -> GyroRest:
    """Return a rest of five readings a second."""
    return GyroRest(t_s, mean_rad_s, readings, 0.2 * readings, noise**2 * (readings - 1))


def rests_of(bias: float, walk: float, noise: float, counts: list[int], seed: int) -> list[GyroRest]:
    """Return rests each 100 s of a bias that drifts."""
    rng = np.random.default_rng(seed)
    rests = []
    for number, count in enumerate(counts):
        bias += 10.0 * walk * rng.standard_normal() * (number > 0)
        mean = bias + noise / math.sqrt(count) * rng.standard_normal()
        rests.append(rest(100.0 * number, mean, count, noise))
    return rests


def test_the_deviation_covers_the_bias_in_its_share_of_cases() -> None:
    inside = 0
    for seed in range(200):
        rests = rests_of(0.003, 1e-6, 2e-3, [5, 200, 5, 5, 80, 5, 5, 40], SEED + seed)
        learned = learn_bias(rests, 0.0, FilterSettings())
        inside += abs(learned.bias_rad_s - 0.003) <= 1.96 * learned.sd_rad_s
    assert inside >= 170, f"seeds from {SEED}"


def test_a_short_rest_counts_for_little() -> None:
    """Ten seconds say 0, then a swing of a second says 0.01 rad/s."""
    rests = [rest(100.0 * number, 1e-5 * (-1) ** number, 100) for number in range(6)]
    before = learn_bias(rests, 0.0, FilterSettings())
    after = learn_bias([*rests, rest(600.0, 0.01, 5)], 0.0, FilterSettings())
    assert abs(before.bias_rad_s) < 1e-4
    assert abs(after.bias_rad_s) < 0.002
    assert not after.is_significant


def test_a_coarse_gyro_knows_its_bias_no_better_than_its_steps_allow() -> None:
    rests = [rest(100.0 * number, 0.004, 100) for number in range(6)]
    fine, coarse = learn_bias(rests, 1e-6, FilterSettings()), learn_bias(rests, 0.02, FilterSettings())
    assert fine.is_significant
    assert coarse.sd_rad_s >= 0.02 / math.sqrt(12.0 * 6.0) * 0.9
    assert not coarse.is_significant


def test_a_body_that_swings_in_short_rests_has_no_bias() -> None:
    """Six rests of the measured mower, the last of 0.6 s: its mean is that of a swing of 0.2 degrees."""
    rows = (
        (30.0, 6.2e-6, 223, 2.3e-4),
        (110.0, 8.3e-5, 79, 6.1e-4),
        (240.0, -1.5e-4, 20, 2.1e-3),
        (330.0, 6.6e-5, 91, 6.5e-4),
        (440.0, -5.4e-5, 16, 1.7e-3),
        (560.0, 5.0e-3, 3, 4.7e-3),
    )
    learned = learn_bias([rest(*row) for row in rows], 1e-6, FilterSettings())
    assert not learned.is_significant
    assert np.abs(learned.biases_rad_s).max() < 5e-4


def test_a_rest_tells_the_bias_of_the_way_before_it() -> None:
    rests = rests_of(0.003, 1e-6, 2e-3, [3, 40, 40, 40, 40, 200], SEED)
    learned = learn_bias(rests, 0.0, FilterSettings())
    assert learned.biases_rad_s[0] == pytest.approx(0.003, abs=4e-4)
    assert learned.filter.gyro_bias_rad_s == pytest.approx(learned.sds_rad_s[0])


def test_few_rests_use_the_noise_of_the_settings() -> None:
    settings = FilterSettings()
    learned = learn_bias([rest(0.0, 0.001, 4)], 0.0, settings)
    assert learned.filter.gyro_rate_noise_rad_s == settings.gyro_rate_noise_rad_s
    assert learned.sd_rad_s == pytest.approx(settings.gyro_rate_noise_rad_s / 2.0, rel=0.05)
    assert not learned.is_significant


def import_increments(command: Command, rows: np.ndarray, columns: str = COLUMNS) -> None:
    lines = ["t,distance,turn", *(",".join(map(repr, row)) for row in rows.tolist())]
    Path("drive.csv").write_text("\n".join(lines) + "\n", "utf-8")
    Path("columns.toml").write_text(columns, "utf-8")
    assert command("import", "table", "drive.csv", "--columns", "columns.toml", "--out", "drive.mcap") == 0


def drive_with_rests(bias_rad_s: float) -> np.ndarray:
    """Return increments of 0.2 s: five legs of 20 m with a rest of 10 s before each."""
    rng = np.random.default_rng(SEED)
    speeds = np.tile(np.repeat([0.0, 1.0], [50, 100]), 5)
    turns = 0.2 * bias_rad_s + 1e-4 * rng.standard_normal(len(speeds))
    jitter = 1e-4 * rng.random(len(speeds)) * (speeds == 0.0)
    return np.column_stack((0.2 * np.arange(len(speeds)), 0.2 * speeds + jitter, turns))


def last_pose(path: str) -> tuple[float, float, float]:
    *_, last = (
        message.json() for message in LogReader(Path(path)).messages() if message.topic == "/estimate"
    )
    assert isinstance(last, dict)
    pose = last["estimate"]
    return pose["x_m"], pose["y_m"], pose["yaw_rad"]


def test_a_bias_of_the_increments_is_learned_at_the_rests_and_corrected(command: Command) -> None:
    import_increments(command, drive_with_rests(0.01))
    assert "rad/s: it is corrected" in command.out
    x_m, y_m, _ = last_pose("drive.mcap")
    assert x_m == pytest.approx(100.0, abs=0.5)
    assert abs(y_m) < 2.0
    assert command("replay", "drive.mcap") == 0


def test_the_way_before_the_first_rest_is_corrected_while_it_is_driven(command: Command) -> None:
    """On the first leg, 20 s before the first rest, the gyro's bias turned the estimate by 6 degrees."""
    import_increments(command, drive_with_rests(0.005)[50:])
    assert "rad/s: it is corrected" in command.out
    log = LogReader(Path("drive.mcap"))
    messages = [message for message in log.messages() if message.topic == "/estimate"]
    first_ns = messages[0].t_ns
    before_rest = [message for message in messages if message.t_ns < first_ns + 19_500_000_000]
    pose = cast("dict[str, Any]", before_rest[-1].json())["estimate"]
    assert abs(pose["yaw_rad"]) < 0.02


def test_a_bias_that_may_be_none_changes_nothing(command: Command) -> None:
    rows = drive_with_rests(0.0)
    import_increments(command, rows)
    assert "it may be none, and is not corrected" in command.out
    pose = last_pose("drive.mcap")
    Path("drive.mcap").unlink()
    import_increments(command, rows, COLUMNS.replace("turn_by_gyro = true\n", ""))
    assert last_pose("drive.mcap") == pose


def test_a_drive_without_a_rest_is_told(command: Command) -> None:
    rows = drive_with_rests(0.0)
    rows[:, 1] = 0.2
    import_increments(command, rows)
    assert "no rest of half a second" in command.out


def position_rms(path: str) -> tuple[float, float]:
    """Return rms of the position by estimate and by odometry, moved onto the first true pose."""
    tracks: dict[str, list[tuple[float, ...]]] = {"estimate": [], "odometry": [], "truth": []}
    for message in LogReader(Path(path)).messages():
        record = message.json() if message.topic in ("/estimate", "/truth") else None
        if not isinstance(record, dict):
            continue
        for name, pose in (
            ("estimate", record.get("estimate")),
            ("odometry", record.get("odometry")),
            ("truth", record if message.topic == "/truth" else None),
        ):
            if pose is not None:
                tracks[name].append((message.t_ns, pose["x_m"], pose["y_m"], pose["yaw_rad"]))
    truth = np.array(tracks["truth"])
    errors = []
    for name in ("estimate", "odometry"):
        track = np.array(tracks[name])
        x, y = (np.interp(truth[:, 0], track[:, 0], track[:, place]) for place in (1, 2))
        yaw = np.interp(truth[:, 0], track[:, 0], np.unwrap(track[:, 3]))
        turned = np.exp(1j * (truth[0, 3] - yaw[0])) * (x - x[0] + 1j * (y - y[0]))
        error = turned - (truth[:, 1] - truth[0, 1] + 1j * (truth[:, 2] - truth[0, 2]))
        errors.append(float(np.sqrt(np.mean(np.abs(error) ** 2))))
    return errors[0], errors[1]


@pytest.mark.slow
@pytest.mark.parametrize(("bias_rad_s", "share"), first_often([(0.005, 1.0 / 3.0), (0.0, 1.0)]))
def test_the_measured_mower_is_not_made_worse_and_a_bias_is_taken_out(
    command: Command, shared_data: Path, bias_rad_s: float, share: float
) -> None:
    folder = shared_data / "vehicles" / "mower"
    Path("truth.csv.gz").write_bytes((folder / "truth.csv.gz").read_bytes())
    text = gzip.decompress((folder / "increments.csv.gz").read_bytes()).decode().splitlines()[1:]
    rows = np.array([[float(cell) for cell in line.split(",")] for line in text])
    rows[:, 2] += bias_rad_s * np.diff(rows[:, 0], prepend=rows[0, 0] - 0.2)
    import_increments(command, rows, COLUMNS + TRUTH)
    by_estimate_m, by_odometry_m = position_rms("drive.mcap")
    assert by_estimate_m <= share * by_odometry_m + 1e-3
