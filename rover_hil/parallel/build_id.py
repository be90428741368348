"""What the numbers of a run depend on: the source of this program, the packages that compute, and BLAS.

OpenBLAS has another kernel for each family of processors; the last bits of a product depend on it.
"""

import hashlib
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

# Loaded here so that `threadpoolctl` finds the libraries of both.
import numpy as np  # noqa: F401
import scipy.linalg  # noqa: F401

from drivers.errors import ConfigError

try:
    from threadpoolctl import threadpool_info
except ModuleNotFoundError as missing:
    raise ConfigError("--cluster needs threadpoolctl: install rover-hil[cluster]") from missing

OWN_PACKAGES = ("controllers", "drivers", "rover_hil", "sim_backends")
NUMERIC_PACKAGES = ("numpy", "scipy", "numba", "filterpy", "opencv-python-headless")
SUFFIXES = frozenset((".py", ".toml", ".json"))
DIGITS = 12


@cache
def build_id() -> str:
    """Return a text that differs where a call could give other numbers: source, Python, numeric packages."""
    digest = hashlib.sha256()
    for package in OWN_PACKAGES:
        folder = _folder(package)
        for path in sorted(path for path in folder.rglob("*") if path.suffix in SUFFIXES):
            digest.update(f"{package}/{path.relative_to(folder).as_posix()}\0".encode())
            digest.update(path.read_bytes())
    numerics = ", ".join(f"{package} {_version(package)}" for package in NUMERIC_PACKAGES)
    source = f"rover-hil {_version('rover-hil')} (source {digest.hexdigest()[:DIGITS]})"
    return f"{source}, Python {platform.python_version()}, {numerics}, BLAS kernel {_blas_kernel()}"


def _blas_kernel() -> str:
    """Return the kernels of numpy and scipy; other packages bring libraries of their own."""
    libraries = [library for library in threadpool_info() if library["user_api"] == "blas"]
    own = [library for library in libraries if _is_of_numpy(Path(library["filepath"]))]
    kernels = {str(library["architecture"]) for library in own or libraries if "architecture" in library}
    return " and ".join(sorted(kernels)) or "unknown"


def _is_of_numpy(library: Path) -> bool:
    """Return whether a wheel of numpy or scipy brought a library; distributions keep BLAS elsewhere."""
    return any(part.startswith(("numpy", "scipy")) for part in library.parts)


def _folder(package: str) -> Path:
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(f"no package {package}", name=package)
    return Path(spec.origin).parent


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
