"""Write the drives and their answers: `python -m tests.nature.odd_drives FOLDER --first SEED`."""

import argparse
import json
from pathlib import Path

import numpy as np

from tests.nature.odd_drives.cases import FAULTY, Case
from tests.nature.odd_drives.motion import Array, Drive
from tests.nature.odd_drives.sound import SOUND

PATH_STEP_S = 0.5


def true_path(driven: Drive) -> list[list[float]]:
    """Return time, x, y and yaw each half a second, and at the end."""
    times: Array = np.append(np.arange(0.0, driven.t[-1], PATH_STEP_S), driven.t[-1])
    poses = driven.at(driven.pose, times)
    return [[round(float(value), 4) for value in (t, *pose)] for t, pose in zip(times, poses, strict=True)]


def write_case(case: Case, folder: Path, rng: np.random.Generator) -> None:
    """Write input and answer of a case."""
    driven, recording = case.make(rng)
    folder.mkdir(parents=True)
    answer = {
        "class": case.group,
        "cause": case.cause,
        "words": list(case.words),
        "not_words": list(case.not_words),
        "decidable": case.decidable,
        "silent_is_right": case.silent_is_right,
        "import": recording.write(folder),
        "true_path": true_path(driven),
    }
    (folder / "answer.json").write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Write a folder for each case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="seed of all drives")
    parser.add_argument("--only", default="", metavar="TEXT", help="only cases whose name contains this")
    arguments = parser.parse_args()
    for index, case in enumerate([*FAULTY, *SOUND]):
        if arguments.only in case.name:
            rng = np.random.default_rng([arguments.first, index])
            write_case(case, arguments.folder / f"{index:03d}_{case.name}", rng)


if __name__ == "__main__":
    main()
