"""What the numbers of a run depend on: this program, the libraries that compute, BLAS and the processor.

Each log names them, and the workers of a cluster compare them. OpenBLAS has another kernel for each family of
processors; the last bits of a product depend on it.
"""

import hashlib
import platform
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType

# Loaded here so that `threadpoolctl` finds the libraries of both.
import numpy as np  # noqa: F401
import scipy.linalg  # noqa: F401
from threadpoolctl import threadpool_info

OWN_PACKAGES = ("controllers", "drivers", "rover_hil", "sim_backends")
NUMERIC_PACKAGES = ("numpy", "scipy", "numba", "filterpy", "opencv-python-headless")
SUFFIXES = frozenset((".py", ".toml", ".json"))
DIGITS = 12

PROGRAM = "rover-hil"
PYTHON, C_LIBRARY = "Python", "C library"
BLAS_KERNEL, PROCESSOR = "BLAS kernel", "processor"
FACTS = (PROGRAM, PYTHON, *NUMERIC_PACKAGES, C_LIBRARY, BLAS_KERNEL, PROCESSOR)
"""Keys in the metadata of a log, in the order in which they are shown."""
UNKNOWN = "unknown"

_CPU_INFO = Path("/proc/cpuinfo")
_CPU_NAMES = ("model name", "Model")


@cache
def made_with() -> Mapping[str, str]:
    """Return what this process computes with, by the names in `FACTS`."""
    return MappingProxyType(
        {
            PROGRAM: f"{_version('rover-hil')} (source {_source_digest()})",
            PYTHON: platform.python_version(),
            **{package: _version(package) for package in NUMERIC_PACKAGES},
            C_LIBRARY: " ".join(filter(None, platform.libc_ver())) or UNKNOWN,
            BLAS_KERNEL: _blas_kernel(),
            PROCESSOR: _processor(),
        }
    )


def changes_since(log_facts: Mapping[str, str]) -> Iterator[str]:
    """Yield a sentence for each fact of a log that is another one here, the program first.

    Args:
        log_facts: What the log names, by the names in `FACTS`; empty for a log that does not.
    """
    here = made_with()
    if PROGRAM not in log_facts:
        yield f"made with a {PROGRAM} that did not note its version in a log, replayed with {here[PROGRAM]}"
        return
    for name in FACTS:
        was = log_facts.get(name, UNKNOWN)
        if was != here[name]:
            yield f"made with {name} {was}, replayed with {here[name]}"


def _source_digest() -> str:
    digest = hashlib.sha256()
    for package in OWN_PACKAGES:
        folder = _folder(package)
        for path in sorted(path for path in folder.rglob("*") if path.suffix in SUFFIXES):
            digest.update(f"{package}/{path.relative_to(folder).as_posix()}\0".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:DIGITS]


def _blas_kernel() -> str:
    """Return the kernels of numpy and scipy; other packages bring libraries of their own."""
    libraries = [library for library in threadpool_info() if library["user_api"] == "blas"]
    own = [library for library in libraries if _is_of_numpy(Path(library["filepath"]))]
    kernels = {str(library["architecture"]) for library in own or libraries if "architecture" in library}
    return " and ".join(sorted(kernels)) or UNKNOWN


def _is_of_numpy(library: Path) -> bool:
    """Return whether a wheel of numpy or scipy brought a library; distributions keep BLAS elsewhere."""
    return any(part.startswith(("numpy", "scipy")) for part in library.parts)


def _processor() -> str:
    """Return the name of the processor; of an ARM computer that has none, that of the board."""
    try:
        lines = _CPU_INFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    facts = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    return next((facts[name] for name in _CPU_NAMES if facts.get(name)), platform.machine() or UNKNOWN)


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
