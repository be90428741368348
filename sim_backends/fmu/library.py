"""FMPy, which is an optional dependency."""

import importlib
from types import ModuleType

from drivers.errors import ConfigError


def fmpy(module: str = "") -> ModuleType:
    """Return FMPy, or one of its modules.

    Raises:
        ConfigError: It is not installed.
    """
    try:
        return importlib.import_module(f"fmpy.{module}" if module else "fmpy")
    except ModuleNotFoundError as missing:
        raise ConfigError("functional mock-up units need FMPy: install rover-hil[fmi]") from missing
