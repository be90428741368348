"""What a commissioning with pose fixes learns of the reading of the yaw excitation."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from benchmarks.gates.floors import configure_version, drive_config
from benchmarks.safety.missions import ground_camera, with_fixes
from controllers.slip.effort.labelled_windows import LabelledReading
from controllers.slip.effort.learned_bracket import LearnedBracket
from controllers.slip.effort.settings import SlipSettings
from controllers.slip.effort.slip_bracket import DrivenTravel, SlipReading
from rover_hil.config import load_config, read_config_text
from rover_hil.drives.marks import Marks
from rover_hil.ready.commission import learning, procedure
from rover_hil.ready.commission.drive import Poses
from rover_hil.ready.commission.learning import (
    LEAST_LABELS,
    LEAST_SD,
    LEAST_SMOOTH,
    LearnedReading,
    learn_bracket,
    learn_reading,
    read_labels,
)
from rover_hil.ready.commission.procedure import Commissioning, Plan
from rover_hil.ready.procedure import Request
from rover_hil.run.driving import run_virtual

SLIP = SlipSettings(maps=load_config("robotino").slip.maps)  # type: ignore[union-attr]
SLIP_SD = 0.01


def labels(
    count: int, secant_share: float, width_share: float, scatter: float = 0.02
) -> list[LabelledReading]:
    """Return readings of a contact that takes these shares."""
    rng = np.random.default_rng(count)
    found = []
    for _ in range(count):
        secant, width = float(rng.uniform(0.05, 0.5)), float(rng.uniform(0.0, 0.3))
        noise = float(np.hypot(scatter, SLIP_SD) * rng.standard_normal())
        slip = secant_share * secant + width_share * width + noise
        found.append(LabelledReading(secant, width, float(rng.uniform(0.1, 0.2)), 10.0, slip, SLIP_SD))
    return found


def learn(found: list[LabelledReading]) -> LearnedBracket:
    return learn_bracket(found, "runs", "2026-11-27")


@pytest.mark.parametrize("shares", [(1.0, 0.0), (0.7, 0.9), (1.2, 0.3)])
def test_the_shares_of_a_contact_are_learned_within_their_deviations(shares: tuple[float, float]) -> None:
    learned = learn(labels(39, *shares))
    sd = np.sqrt(np.diag(np.array(learned.covariance).reshape(2, 2)))
    assert abs(learned.weights[0] - shares[0]) < 3.0 * sd[0] < 0.2
    assert abs(learned.weights[1] - shares[1]) < 3.0 * sd[1] < 0.35
    assert learned.residual_sd == pytest.approx(0.02, abs=0.012)
    assert learned.windows == 39


def test_few_labels_leave_the_formula_and_more_change_it() -> None:
    off = [abs(learn(labels(count, 0.5, 0.5)).weights[0] - 0.5) for count in (1, 5, LEAST_LABELS, 39)]
    assert off[0] > 0.2
    assert off[-1] < 0.1


def test_from_forty_labels_on_the_shares_follow_the_speed_where_they_change_with_it() -> None:
    def changing(count: int) -> list[LabelledReading]:
        return [
            each._replace(slip=each.slip + 8.0 * (each.speed_m_s - 0.15) * each.secant)
            for each in labels(count, 0.7, 0.3)
        ]

    few, many = learn(changing(LEAST_SMOOTH - 1)), learn(changing(LEAST_SMOOTH + 20))
    assert (len(few.weights), len(many.weights)) == (2, 7)
    assert many.residual_sd < 0.6 * few.residual_sd
    off = []
    for each in changing(200):
        read, _ = many.read(
            SlipReading(0.0, 1.0, "", each.secant, each.secant + each.width),
            DrivenTravel(each.speed_m_s, each.force_n),
        )
        off.append((each.slip - read.slip) / np.hypot(read.sd, SLIP_SD))
    assert np.mean(np.abs(off) < 2.0) > 0.85


def test_the_deviation_holds_for_labels_that_were_not_learned() -> None:
    fresh = labels(500, 0.8, 0.7)
    learned = learn(labels(25, 0.8, 0.7))
    off = [
        label.slip - learned.weights[0] * label.secant - learned.weights[1] * label.width for label in fresh
    ]
    inside = [abs(each) < 2.0 * np.hypot(learned.residual_sd, SLIP_SD) for each in off]
    assert np.mean(inside) > 0.85


def test_what_was_driven_is_the_domain() -> None:
    found = labels(30, 1.0, 0.5, scatter=0.0)
    learned = learn(found)
    assert learned.secant_range == (min(each.secant for each in found), max(each.secant for each in found))
    assert learned.speed_range_m_s == (
        min(each.speed_m_s for each in found),
        max(each.speed_m_s for each in found),
    )
    assert learned.force_range_n == (10.0, 10.0)
    assert learned.residual_sd == LEAST_SD
    assert learn([*found[1:], found[0]._replace(force_n=None)]).force_range_n is None


def test_a_commissioning_with_pose_fixes_writes_a_file_that_a_configuration_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = {"line": labels(15, 0.8, 0.4), "square": labels(16, 0.8, 0.4)}
    monkeypatch.setattr(learning, "read_labels", lambda path: found[path.name])
    path = tmp_path / "learned_bracket.toml"
    learned, words = learn_reading([Path("line"), Path("square")], path, SLIP)
    assert learned is not None
    assert (learned.windows, learned.source) == (31, str(tmp_path))
    assert "of the secant and" in words
    match = re.search(r"from 31 readings, off one that was left out by (0\.0\d+) \(rms; (0\.\d+) with", words)
    assert match is not None, words
    assert float(match[1]) < float(match[2])
    text = read_config_text("robotino")
    rover = tmp_path / "rover.toml"
    rover.write_text(text.replace("[slip]\n", '[slip]\nlearned_bracket = "learned_bracket.toml"\n'), "utf-8")
    slip = load_config(str(rover)).slip
    assert slip is not None
    assert slip.learned_bracket is not None
    assert slip.learned_bracket.weights == pytest.approx(learned.weights, rel=1e-4)
    assert slip.learned_bracket.force_range_n == learned.force_range_n
    assert slip.learned_bracket.conditions == "excitation 2 Hz of 12, gyro unknown"


def test_too_few_labels_teach_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learning, "read_labels", lambda _: labels(LEAST_LABELS - 1, 1.0, 0.5))
    path = tmp_path / "learned_bracket.toml"
    learned, words = learn_reading([Path("line")], path, SLIP)
    assert learned is None
    assert words == (
        "nothing: fixes or camera have labelled 19 readings of the yaw excitation, 20 are needed: drive more "
        "laps"
    )
    assert not path.exists()


@pytest.mark.parametrize(
    ("shipped", "fixes_per_s", "learns"),
    [("robotino", None, False), ("robotino", 0.5, True), ("robotino-camera", None, True)],
)
def test_only_with_fixes_or_ground_motion_a_commissioning_learns(
    shipped: str, fixes_per_s: float | None, learns: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Path] = []

    def learn(logs: list[Path], path: Path, slip: SlipSettings) -> LearnedReading:
        asked.append(path)
        return LearnedReading(None, "nothing")

    monkeypatch.setattr(procedure, "learn_reading", learn)
    monkeypatch.setattr(procedure, "find_worth", lambda _: None)
    monkeypatch.setattr(procedure, "learn_ground", lambda _: None)
    config = load_config(shipped)
    commissioning = Commissioning("rover.toml", Plan(side_m=1.0, laps=1, tape_sd_m=0.005), ())
    commissioning.configure(
        Request(source="rover.toml"), config if fixes_per_s is None else with_fixes(config, fixes_per_s)
    )
    drive = ("line", cast(Poses, SimpleNamespace(path=Path("runs/line.mcap"))), cast(Marks, None))
    commissioning.fit([drive])
    assert asked == ([Path("runs/learned_bracket.toml")] if learns else [])
    (line, *_) = commissioning.drives(config)
    assert line.config.slip is not None
    assert line.config.slip.excite_beside_ground is (shipped == "robotino-camera")


@pytest.mark.slow
def test_a_drive_with_fixes_labels_the_readings_of_the_excitation(tmp_path: Path) -> None:
    """On a contact that was used to derive nothing; the labels of the log are those of the drive."""
    config = with_fixes(load_config("robotino"), 1.0)
    log = tmp_path / "drive.mcap"
    run_virtual(config, log, 20.0, None)
    found = read_labels(log)
    assert len(found) >= 3
    for label in found:
        assert label.slip == pytest.approx(label.secant + 0.5 * label.width, abs=0.2)
        assert 0.0 <= label.secant < 1.0
        assert label.speed_m_s == pytest.approx(0.15, abs=0.06)
        assert 0.0 < label.slip_sd < 0.05


@pytest.mark.parametrize(("per_slip", "noise_rad", "expected"), [(0.4, 0.03, 0.4), (0.0, 0.05, 0.0)])
def test_drift_is_learned_where_it_is_more_than_noise(
    per_slip: float, noise_rad: float, expected: float
) -> None:
    rng = np.random.default_rng(5)
    found = [
        each._replace(drift_rad=per_slip * each.slip + noise_rad * float(rng.standard_normal()))
        for each in labels(40, 0.8, 0.4)
    ]
    learned = learn_bracket(found, "here", "2026-11-28")
    assert learned.drift_per_slip == pytest.approx(expected, abs=0.05 if expected else 0.0)
    assert learned.drift_sd_rad == pytest.approx(noise_rad, rel=0.3)
    few = [each._replace(drift_rad=None) for each in found[:-5]] + found[-5:]
    assert learn_bracket(few, "here", "2026-11-28").drift_per_slip == 0.0


@pytest.mark.slow
def test_a_camera_that_measures_the_ground_labels_readings_of_the_excitation() -> None:
    """Labels by the ground are near the slip that the reading gives; without the key there are none."""
    config = configure_version("calibrated gyro", 7)
    assert config.slip is not None
    found = {}
    for excites in (False, True):
        slip = config.slip.model_copy(update={"excite_beside_ground": excites})
        driven = drive_config(
            config.model_copy(update={"slip": slip}), "bristle", 7, make_camera=ground_camera(7)
        )[1]
        reports = [moment.output.slip for moment in driven.moments]
        found[excites] = [each.label for each in reports if each is not None and each.label is not None]
    assert found[False] == []
    errors = np.array([each.slip - each.secant - 0.5 * each.width for each in found[True]])
    assert len(errors) >= 5
    assert np.sqrt(np.mean(errors**2)) < 0.15
