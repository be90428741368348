"""The generator of faulty recordings: its paths follow from its wheels, and its answers can be judged."""

import ast
import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.nature.odd_drives.__main__ import write_case
from tests.nature.odd_drives.cases import FAULTY
from tests.nature.odd_drives.motion import CAR, FOUR, LARGE, OMNI, SMALL, STEP_S, Rover, drive, tour
from tests.nature.odd_drives.sound import SOUND

HERE = Path(__file__).parent / "odd_drives"


@pytest.mark.parametrize("rover", [SMALL, LARGE, FOUR, OMNI, CAR])
def test_wheels_without_slip_give_the_true_path(rover: Rover) -> None:
    rng = np.random.default_rng(3)
    driven = drive(rover, tour(rover, rng, seconds=30.0, back=True), rng, slip=0.0)
    rows = [[np.cos(a), np.sin(a), x * np.sin(a) - y * np.cos(a)] for x, y, a in rover.wheels.values()]
    rims = driven.speeds * rover.radius_m
    if rover is CAR:
        forward = rims.mean(axis=1)
        body = np.stack((forward, np.zeros_like(forward), forward * np.tan(driven.steering) / 2.7), axis=1)
    else:
        body = np.linalg.lstsq(np.array(rows), rims.T, rcond=None)[0].T
    yaw = driven.pose[0, 2] + np.cumsum(body[:, 2]) * STEP_S
    x = np.cumsum(body[:, 0] * np.cos(yaw) - body[:, 1] * np.sin(yaw)) * STEP_S
    y = np.cumsum(body[:, 0] * np.sin(yaw) + body[:, 1] * np.cos(yaw)) * STEP_S
    end = driven.pose[-1] - driven.pose[0]
    assert [x[-1], y[-1]] == pytest.approx(end[:2].tolist(), abs=2e-3 * float(np.abs(rims).sum() * STEP_S))
    assert yaw[-1] - driven.pose[0, 2] == pytest.approx(end[2], abs=0.01)


def test_each_answer_is_complete_and_its_words_are_expressions() -> None:
    cases = [*FAULTY, *SOUND]
    assert len({case.name for case in cases}) == len(cases)
    assert len(FAULTY) >= 60
    assert len(SOUND) >= 40
    for case in FAULTY:
        assert case.cause
        assert case.words
        for pattern in (*case.words, *case.not_words):
            re.compile(pattern)


@pytest.mark.parametrize("name", ["exchanged_later_small", "can_delta_small", "bag_set_back"])
def test_one_seed_gives_the_same_files(name: str, tmp_path: Path) -> None:
    case = next(case for case in FAULTY if case.name == name)
    for folder in ("one", "two"):
        write_case(case, tmp_path / folder, np.random.default_rng([5, 6]))
    answer = json.loads((tmp_path / "one" / "answer.json").read_text())
    assert answer["class"] == case.group
    assert (tmp_path / "one" / "answer.json").read_bytes() == (tmp_path / "two" / "answer.json").read_bytes()
    source = answer["import"][1]
    assert (tmp_path / "one" / source).exists()


def test_it_imports_nothing_of_the_program() -> None:
    for path in HERE.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                assert name.split(".")[0] not in {"rover_hil", "controllers", "drivers", "sim_backends"}, path
