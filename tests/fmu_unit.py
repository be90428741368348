"""The example of a functional mock-up unit, built once, for the tests."""

from pathlib import Path

import pytest

from drivers.errors import ConfigError
from sim_backends.fmu.example.build import build_unit, compiler
from sim_backends.fmu.library import fmpy


def has_fmpy() -> bool:
    try:
        fmpy()
    except ConfigError:
        return False
    return True


needs_a_unit = [
    pytest.mark.skipif(not compiler(), reason="no C compiler to build a unit"),
    pytest.mark.skipif(not has_fmpy(), reason="FMPy is not installed"),
]

TOML = """
fmu = "axis.fmu"
step_s = 0.04

[inputs]
voltage = {}

[channels.encoder]
variable = "angle"
sigma = 0.005

[signals]
speed = {}

[parameters]
damping = { prior_sd = 0.004, lower = 0.001, upper = 0.1 }
inertia = { prior_sd = 0.0003, lower = 0.001, upper = 0.05 }

[run_parameters]
first_angle = { prior_sd = 0.01, channel = "encoder" }
first_speed = { prior_sd = 2.0 }

[effects.coulomb_friction]
sentence = "Dry friction opposes the motion."
strength = { variable = "friction", name = "level", size = 0.01, lower = 0.0 }

[effects.push]
sentence = "A constant torque acts on the axis."
strength = { variable = "offset", size = 0.01 }

[effects.wrong_inertia]
sentence = "The load is not what it was taken for."
releases = "inertia"
strength = { size = 0.001 }
"""


def unit_folder(folder: Path, *, version: int = 2, code: str = "", toml: str = TOML) -> Path:
    """Write a unit and the file beside it; returns the file."""
    build_unit(folder / "axis.fmu", version=version, code=code)
    (folder / "axis.toml").write_text(toml, "utf-8")
    return folder / "axis.toml"
