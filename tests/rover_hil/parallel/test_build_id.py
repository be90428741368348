"""The identity of a build does not depend on what else a process has loaded."""

import subprocess
import sys

import pytest

from rover_hil.parallel.build_id import build_id

PROGRAM = "{first}import rover_hil.parallel.build_id as build; print(build.build_id())"


def build_after(first: str) -> str:
    found = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(first=first)], capture_output=True, text=True, check=True
    )
    return found.stdout.strip()


@pytest.mark.parametrize("package", ["cv2", "sklearn"])
@pytest.mark.slow
def test_a_package_that_brings_libraries_of_its_own_changes_nothing(package: str) -> None:
    pytest.importorskip(package)
    assert build_after("") == build_after(f"import {package}; ") == build_id()


def test_the_build_names_what_the_numbers_depend_on() -> None:
    names = ("rover-hil", "source", "Python", "numpy", "scipy", "numba", "filterpy", "opencv", "BLAS kernel")
    for name in names:
        assert name in build_id()
    assert "not installed" not in build_id()
