"""Build the example: `python -m sim_backends.fmu.example axis.fmu`."""

import sys
from pathlib import Path

from drivers.errors import ConfigError
from sim_backends.fmu.example.build import build_unit


def main(arguments: list[str]) -> str:
    """Build the unit; returns what is wrong, empty for nothing."""
    if len(arguments) != 1:
        return "usage: python -m sim_backends.fmu.example FILE.fmu"
    try:
        build_unit(Path(arguments[0]))
    except ConfigError as error:
        return str(error)
    return ""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]) or 0)
