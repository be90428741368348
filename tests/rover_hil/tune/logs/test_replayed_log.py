"""What a replay with other values gives: the estimates of the log, known noise, and independent judges."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from drivers.errors import LogError
from drivers.samples import PoseFixSample
from rover_hil.config import Config, load_config
from rover_hil.recording.data_files import collect_data_files, restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import CYCLE, ESTIMATE, ESTIMATE_SHAPE
from rover_hil.recording.writer import LogWriter
from rover_hil.run.replay import estimate_again
from rover_hil.tune.logs.judged_log import JudgedLog, read_judged_logs
from rover_hil.tune.logs.objective import consistency, mean_nees, pooled_terms
from rover_hil.tune.logs.replayed_log import ReplayErrors, replay_with
from rover_hil.tune.parameters import with_values
from tests.rover_hil.tune.logs.drives import COMPASS_RAD, GYRO_RAD_S, write_config, write_drives

HEADING = "filter.heading_noise_rad"
RATE = "filter.gyro_rate_noise_rad_s"
WALK = "filter.gyro_noise_rad_sqrt_s"
TRUE = {HEADING: COMPASS_RAD, RATE: GYRO_RAD_S, WALK: GYRO_RAD_S / math.sqrt(50.0)}


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Config, JudgedLog]:
    folder = tmp_path_factory.mktemp("drive")
    paths = write_drives(folder, range(7, 8))
    config = load_config(str(write_config(folder)))
    (log,) = read_judged_logs(paths, config, 5.0)
    return config, log


def test_the_values_of_the_log_give_its_estimates_and_others_the_same_set_points(
    drive: tuple[Config, JudgedLog], tmp_path: Path
) -> None:
    _, log = drive
    path = tmp_path / "run.mcap"
    path.write_bytes(log.content)
    reader = LogReader(path)
    recorded = [
        reader.parse(message, ESTIMATE_SHAPE) for message in reader.messages() if message.topic == ESTIMATE
    ]
    with restore_config(reader) as logged:
        same = list(estimate_again(reader, logged))
        other = list(estimate_again(reader, with_values(logged, {HEADING: 0.05})))
    assert len(same) == len(other) == len(recorded) > 300
    for output, record in zip(same, recorded, strict=True):
        estimate = record["estimate"]
        assert output.estimate.x_m == pytest.approx(estimate["x_m"], abs=1e-6)
        assert output.estimate.yaw_rad == pytest.approx(estimate["yaw_rad"], abs=1e-6)
    assert max(abs(a.estimate.yaw_rad - b.estimate.yaw_rad) for a, b in zip(same, other, strict=True)) > 0.01
    # The wheels turned as they were commanded in the log, so their odometry is the same.
    assert other[-1].odometry == same[-1].odometry
    assert any(a.command.speed_rad_s != b.command.speed_rad_s for a, b in zip(same, other, strict=True))


@pytest.mark.parametrize(
    "command", [{"speed_rad_s": [1.0, 1.0]}, {"speed_rad_s": [1.0, 1.0, 1.0], "steering_rad": [0.1]}]
)
def test_set_points_of_other_wheels_are_damage(tmp_path: Path, command: dict[str, object]) -> None:
    config, path = load_config("robotino"), tmp_path / "run.mcap"
    with LogWriter(
        path, 1, config.model_dump_json(by_alias=True).encode(), collect_data_files(config), "real"
    ) as log:
        for t_ns in (20_000_000, 40_000_000):
            log.write_json(ESTIMATE, t_ns, {"command": {"t_ns": t_ns, "expires_ns": t_ns, **command}})
            log.write_json(CYCLE, t_ns, {"late_ns": 0, "work_ns": 0})
    with pytest.raises(LogError, match="setpoints of other wheels"):
        list(estimate_again(LogReader(path), config))


def test_the_true_noise_is_consistent_and_others_are_not(drive: tuple[Config, JudgedLog]) -> None:
    config, log = drive
    true, small, large = (
        replay_with(log, with_values(config, {**TRUE, HEADING: factor * COMPASS_RAD}))
        for factor in (1.0, 0.4, 2.5)
    )
    for result, lowest, highest in ((true, 0.75, 1.35), (small, 3.0, 20.0), (large, 0.05, 0.33)):
        ratio, _ = consistency([result])["compass magnetic"]
        assert lowest < ratio < highest
    ratio, correlation = consistency([true])["imu standstill"]
    assert ratio == pytest.approx(1.0, abs=0.3)
    assert abs(correlation) < 0.2
    assert 0.1 < mean_nees([true])["yaw"] < 3.0
    assert pooled_terms([true])["nis"] < min(pooled_terms([one])["nis"] for one in (small, large))


def test_withheld_fixes_judge_before_they_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    from rover_hil.tune.logs import replayed_log

    def fix(
        x: float, y: float, yaw: float, nis: float | None, ends: tuple[str, ...]
    ) -> tuple[Innovation, ...]:
        return tuple(
            Innovation(
                measured=Measured("camera", end),
                residual=value,
                variance=None if nis is None else 0.01,
                nis=nis,
                outcome=Outcome.ACCEPTED,
            )
            for end, value in zip(ends, (x, y, yaw), strict=False)
        )

    parts = ("x", "y", "yaw")
    outputs = [
        type("Output", (), {"innovations": fix(9.0, 9.0, 3.0, 0.0, parts)})(),  # ties the frames together
        type("Output", (), {"innovations": fix(0.03, 0.04, 0.1, 2.0, parts)})(),
        type("Output", (), {"innovations": ()})(),
        type(
            "Output",
            (),
            {
                "innovations": (
                    *fix(0.0, 0.0, 0.0, 0.1, parts),
                    *fix(0.6, 0.2, 0.0, None, ("displaced", "turned")),
                )
            },
        )(),
    ]
    kinds, judged = replayed_log._sort(outputs, ["camera"])
    errors = replayed_log._errors_at_fixes(judged)
    assert kinds == {}
    assert errors.position_m == pytest.approx([0.05, 0.6])
    assert errors.yaw_rad == pytest.approx([0.1, 0.2])
    assert errors.position_nees == pytest.approx([2.0, 100.0])
    assert errors.yaw_nees == pytest.approx([2.0, 100.0])


def test_two_cameras_do_not_help_each_other() -> None:
    """A fix of one is no judge of a prediction that a fix of the other has just corrected."""
    from rover_hil.tune.logs import replayed_log

    is_used = replayed_log._every(5.0, ("left", "right"))
    used = []
    for index in range(120):
        t_ns = 100_000_000 * index
        fix = PoseFixSample(
            device=("left", "right")[index % 2],
            t_ns=t_ns,
            t_capture_ns=t_ns,
            x_m=0.0,
            y_m=0.0,
            yaw_rad=0.0,
            position_std_m=0.01,
            yaw_std_rad=0.01,
        )
        if is_used(fix):
            used.append(0.1 * index)
    assert used == pytest.approx([0.0, 5.0, 10.0])


def replayed(**values: object) -> ReplayErrors:
    arrays = {name: np.ones(4) for name in ("position_m", "yaw_rad", "position_nees", "yaw_nees")}
    return ReplayErrors(**{"name": "a", "refused": "", "innovations": {}, **arrays, **values})  # type: ignore[arg-type]


def test_consistency_is_a_factor_whose_direction_does_not_matter() -> None:
    rng = np.random.default_rng(0)
    for scale in (0.5, 1.0, 2.0):
        values = scale * rng.standard_normal(4000)
        log = replayed(
            position_nees=np.full(4, scale**2), yaw_nees=np.full(4, scale**2), innovations={"compass": values}
        )
        terms = pooled_terms([log])
        assert terms["nees"] == pytest.approx(abs(math.log(scale**2)))
        assert terms["nis"] == pytest.approx(abs(math.log(scale**2)), abs=0.1)
        assert terms["whiteness"] < 0.05
    walk = np.cumsum(rng.standard_normal(4000))
    assert pooled_terms([replayed(innovations={"compass": walk / walk.std()})])["whiteness"] > 0.9


def test_outliers_and_too_few_innovations_do_not_count() -> None:
    rng = np.random.default_rng(1)
    values = rng.standard_normal(1000)
    values[::20] = 1e6
    assert consistency([replayed(innovations={"compass": values})])["compass"][0] == pytest.approx(
        1.0, abs=0.25
    )
    assert consistency([replayed(innovations={"compass": values[:10]})]) == {}


def test_a_log_whose_poses_are_outside_its_cycles_is_said_so(drive: tuple[Config, JudgedLog]) -> None:
    config, log = drive
    assert log.poses is not None
    late = replace(log, poses=replace(log.poses, t_ns=log.poses.t_ns + 10**12))
    with pytest.raises(LogError, match="no known pose"):
        replay_with(late, config)
