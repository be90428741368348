"""The identity of a build does not depend on what else a process has loaded."""

import subprocess
import sys

from rover_hil.parallel.build_id import build_id

PROGRAM = "{first}import rover_hil.parallel.build_id as build; print(build.build_id())"


def build_after(first: str) -> str:
    found = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(first=first)], capture_output=True, text=True, check=True
    )
    return found.stdout.strip()


def test_opencv_and_its_own_library_change_nothing() -> None:
    assert build_after("") == build_after("import cv2; ") == build_id()


def test_the_build_names_what_the_numbers_depend_on() -> None:
    for name in ("rover-hil", "source", "Python", "numpy", "scipy", "numba", "filterpy", "BLAS kernel"):
        assert name in build_id()
