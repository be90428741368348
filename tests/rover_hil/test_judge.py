"""Recorded drives with one fault each, written by an independent generator: the cause is reported, first."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from rover_hil.drives.quality.judge import drive_findings, with_causes
from rover_hil.recording.findings import MOST_CONSEQUENCES, FoundFinding, finding_lines
from tests.nature.odd_drives.__main__ import write_case
from tests.nature.odd_drives.cases import FAULTY
from tests.nature.odd_drives.sound import SOUND
from tests.rover_hil.command import Command

CASES = {case.name: case for case in (*FAULTY, *SOUND)}
SEED = 11
CAUSES = (
    "gyro_late_small",
    "steering_late_car",
    "unsigned_four_positions",
    "unsigned_large_alone",
    "one_of_four_reversed",
    "all_reversed_four_positions",
    "exchanged_later_small",
    "exchanged_omni_truth",
    "gyro_reversed_four_positions",
    "gyro_scale_large_positions",
    "gyro_radians_four",
    "can_rpm_as_rad_s",
    "radius_small_truth",
    "radius_of_left_large",
    "track_small_truth",
    "steering_wheel_car_gyro",
    "steering_wheel_car_positions",
    "coordinates_car_fixes",
    "coordinates_four_truth",
    "held_wheels_small",
    "steps_of_8_mm_small",
    "dead_encoder_large_truth",
)
HEALTHY = ("small_slip_5", "large_gnss_2_m", "four_truth_geodetic", "omni_coarse_gyro", "car_back_truth")


def found_in(command: Command, name: str, folder: Path) -> tuple[list[str], dict[str, list[str]]]:
    """Import a drive without an estimate; return what is found in it, and its answer."""
    write_case(CASES[name], folder, np.random.default_rng([SEED, sorted(CASES).index(name)]))
    answer = json.loads((folder / "answer.json").read_text("utf-8"))
    kind, *words = answer["import"]
    paths = [str(folder / word) if (folder / word).exists() else word for word in words]
    assert command("import", kind, *paths, "--out", "drive.mcap", "--no-estimate") == 0, command.error
    return [finding.text for finding in drive_findings(Path("drive.mcap"))], answer


@pytest.mark.parametrize("name", CAUSES)
def test_the_cause_is_reported_first(command: Command, tmp_path: Path, name: str) -> None:
    (first, *_), answer = found_in(command, name, tmp_path / name)
    assert any(re.search(word, first, re.IGNORECASE) for word in answer["words"]), first
    assert not any(re.search(word, first, re.IGNORECASE) for word in answer["not_words"]), first


@pytest.mark.parametrize("name", HEALTHY)
def test_a_sound_drive_has_no_finding(command: Command, tmp_path: Path, name: str) -> None:
    assert found_in(command, name, tmp_path / name)[0] == []


@pytest.mark.usefixtures("unrendered")
def test_ground_truth_without_yaw_is_compared_after_alignment(command: Command, tmp_path: Path) -> None:
    """The estimate of a sound drive ends where the positions do, in any frame."""
    folder = tmp_path / "positions"
    write_case(CASES["small_20_hz_long"], folder, np.random.default_rng(SEED))
    table, columns = str(folder / "table.csv.gz"), str(folder / "columns.toml")
    assert "yaw" not in Path(columns).read_text("utf-8").partition("[truth]")[2].partition("[")[0]
    assert command("import", "table", table, "--columns", columns, "--out", "drive.mcap") == 0, command.error
    assert command("replay", "drive.mcap", "--out", "page") == 0, command.error
    summary = json.loads(Path("page/summary.json").read_text("utf-8"))
    assert summary["estimate_error"]["position_rms_m"] < 0.05 * summary["distance_truth_m"]
    assert summary["estimate_error"]["yaw_rms_rad"] is None
    assert summary["final_truth"]["yaw_rad"] is None


def test_contradictions_are_consequences_of_a_cause_and_other_findings_are_not() -> None:
    contradictions = [
        FoundFinding(name=name, t_s=1.0, text=name)
        for name in ("gyro follows", "turn", "imu and wheels differ", "/pose_fix displaced", "gyro rate")
    ]
    other = FoundFinding(name="gyro stuck", t_s=1.0, text="stuck")
    doubt = FoundFinding(name="doubt", t_s=2.0, text="doubt")
    cause = FoundFinding(name="gyro", t_s=None, text="the gyro has the opposite sign")
    assert with_causes([], [other], [doubt]) == ([other], [doubt])
    findings, doubts = with_causes([cause], [*contradictions, other], [doubt])
    assert findings == [cause, contradictions[-1], other]
    assert doubts == []
    assert cause.consequences == [*contradictions[:-1], doubt]
    lines = finding_lines(cause)
    assert len(lines) == 2 + MOST_CONSEQUENCES
    assert lines[-1] == "  and 2 more consequences, all of them with --json"
