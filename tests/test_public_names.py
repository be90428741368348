"""What other programs import from `drivers` and `controllers`."""

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/reference/python.md").read_text("utf-8")


@pytest.mark.parametrize("package", ["drivers", "controllers"])
def test_each_public_name_is_there_typed_and_documented(package: str) -> None:
    module = import_module(package)
    names = set(module.__all__)
    assert len(names) > 10
    assert all(getattr(module, name).__doc__ for name in names)
    section = PAGE.split(f"## `{package}`")[1].split("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)) == names
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = module.nothing


def test_the_example_needs_public_names_only_and_gives_the_pose() -> None:
    example = ROOT / "docs/examples/step_the_loop.py"
    assert set(re.findall(r"^from (\S+)", example.read_text("utf-8"), re.MULTILINE)) == {
        "drivers",
        "controllers",
    }
    done = subprocess.run([sys.executable, example], capture_output=True, text=True, check=True)
    assert done.stdout == "x 1.000 m, y 0.000 m, yaw 0.000 rad, observing\n"


def test_importing_a_package_loads_no_heavy_library() -> None:
    heavy = "{'cv2', 'can', 'scipy', 'numpy', 'pydantic'}"
    code = f"import drivers, controllers, sys; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
