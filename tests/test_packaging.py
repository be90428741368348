"""The four generic import names belong to us alone, and importing the package stays cheap."""

import subprocess
import sys
from importlib.metadata import packages_distributions

PACKAGES = ("drivers", "controllers", "sim_backends", "rover_hil")


def test_our_distribution_alone_owns_its_names() -> None:
    owners = packages_distributions()
    for package in PACKAGES:
        assert {owner.lower().replace("_", "-") for owner in owners.get(package, [])} == {"rover-hil"}, (
            package
        )


def test_importing_rover_hil_imports_none_of_its_parts() -> None:
    code = "import rover_hil, sys; print([name for name in sys.modules if name.startswith('rover_hil.')])"
    output = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert output.strip() == "[]"


def test_help_needs_no_heavy_library() -> None:
    code = "import rover_hil.app.app, sys; print({'cv2', 'can', 'scipy', 'numpy'} & set(sys.modules))"
    output = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert output.strip() == "set()"
