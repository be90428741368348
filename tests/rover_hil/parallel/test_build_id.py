"""The identity of a build does not depend on what else a process has loaded."""

import os
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


KERNELS = {"OPENBLAS_CORETYPE": "Haswell"}, {"OPENBLAS_CORETYPE": "Prescott"}
BUILDS = (
    "from rover_hil.parallel.build_id import build_id; print(build_id()); print(build_id(uses_blas=False))"
)
MISSION = """
import hashlib
from rover_hil.config import load_config
from rover_hil.tune.scenarios import with_scenario
from rover_hil.tune.simulated_mission import drive

driven = drive(with_scenario(load_config("robotino"), 1))
parts = driven.truth.x_m, driven.estimate.yaw_rad, driven.set_points_rad_s
print(hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest())
"""


def outputs(program: str, variants: tuple[dict[str, str], ...]) -> list[list[str]]:
    """Return the lines that a program prints on each kernel."""
    return [
        subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, **variables},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.splitlines()
        for variables in variants
    ]


def test_calls_without_blas_may_run_on_another_kernel() -> None:
    (with_blas, without), (other, other_without) = outputs(BUILDS, KERNELS)
    assert with_blas != other
    assert without == other_without
    assert "BLAS kernel" not in without


@pytest.mark.slow
def test_a_mission_without_a_camera_has_the_same_bits_on_every_kernel() -> None:
    first, *others = outputs(MISSION, (*KERNELS, {"NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3"}))
    assert len(first[0]) == 64
    assert all(other == first for other in others)
