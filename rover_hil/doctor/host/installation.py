"""Check the installation of the software."""

import platform
import re
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version

from rover_hil.doctor.finding import Finding, ok, problem

CHECK = "installation"

DISTRIBUTION = "rover-hil"
OWNERS = {
    "drivers": DISTRIBUTION,
    "controllers": DISTRIBUTION,
    "sim_backends": DISTRIBUTION,
    "rover_hil": DISTRIBUTION,
    "can": "python-can",
    "cv2": "opencv-python-headless",
    "serial": "pyserial",
}
"""Import names that other distributions also use, and the only distribution that may own each."""

_NAME = re.compile(r"[A-Za-z0-9._-]+")
_LOWER_BOUND = re.compile(r">=\s*([0-9.]+)")


def check_installation(
    distributions: Mapping[str, Iterable[str]], requirements: Iterable[str]
) -> list[Finding]:
    """Check which distributions own the import names, and the versions of the libraries.

    Args:
        distributions: Import names and the distributions that provide them.
        requirements: The requirements in the metadata of our distribution.
    """
    findings = [
        finding
        for name, owner in OWNERS.items()
        if (finding := _check_owner(name, owner, distributions.get(name, ()))) is not None
    ]
    findings += [finding for text in requirements if (finding := _check_library(text)) is not None]
    if findings:
        return findings
    return [ok(CHECK, "software", f"Python {platform.python_version()}, all libraries new enough")]


def _check_owner(name: str, owner: str, distributions: Iterable[str]) -> Finding | None:
    others = sorted({_normalised(distribution) for distribution in distributions} - {owner})
    if others:
        removal = " ".join(others)
        return problem(
            CHECK,
            f"import name '{name}'",
            f"'{name}' is also provided by {', '.join(others)}",
            f"two distributions wrote into one folder; '{name}' must come from {owner} alone",
            f"pip uninstall {removal}; pip install --force-reinstall --no-deps {owner}",
        )
    if not distributions:
        return problem(
            CHECK,
            f"import name '{name}'",
            f"no installed distribution provides '{name}'",
            "the program was started from its source folder without being installed, or a library is missing",
            "run `make setup` in the source folder and start `.venv/bin/rover-hil`",
        )
    return None


def _check_library(requirement: str) -> Finding | None:
    name, bound = _NAME.match(requirement), _LOWER_BOUND.search(requirement)
    if name is None or bound is None or "extra ==" in requirement:
        return None
    library, oldest = name[0], bound[1]
    try:
        installed = version(library)
    except PackageNotFoundError:
        installed = ""
    if _numbers(installed) >= _numbers(oldest.removesuffix(".0")):
        return None
    return problem(
        CHECK,
        library,
        f"{library} {installed or 'is missing'}, required is {oldest} or newer",
        "older versions have faults that affect this program",
        f"pip install '{library}>={oldest}'",
    )


def _normalised(distribution: str) -> str:
    return distribution.lower().replace("_", "-")


def _numbers(version_text: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", version_text))
