"""Every number of estimators, monitors and stop rules, and what a change by 20 % does to a mission.

    python -m benchmarks.gates.constants > numbers.md      # twelve minutes on two cores
    python -m benchmarks.gates.constants --only slip.effort.parameters.GyroInPlace
    python -m benchmarks.gates.constants --only safety.entrapment --factors 0.5 2

Prints a row for each number that `numbers` finds, as in benchmarks/results/constants.md: its value, and by
how many mm the path of the shipped Robotino changes at 0.8 and at 1.2 of it (whole numbers change by 1) on
a simulated site. Those of sComp are of another rover; those of the motion over the ground are of a rover
with a camera. Those of the wheel's trace change the error of its angle and the share of missed frames on
two drives of ../shared/data/trace_drives.
"""

import argparse
import ast
import importlib
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from unittest import mock

import cv2
import numpy as np
from pydantic import BaseModel
from rich.console import Console
from rich.progress import track

from benchmarks.ftrace.ground_drives import fused
from benchmarks.ftrace.scores import figures as figures_of_trace
from benchmarks.ftrace.scores import together
from benchmarks.safety import missions
from benchmarks.safety.missions import drive, robotino
from benchmarks.sensitivity.table import FACTORS, varied
from controllers.motion.settings import RectangleMission
from controllers.safety import Mode
from drivers.clock import wall_time_text
from rover_hil.config import Config, load_config
from rover_hil.parallel.executor import open_executor
from rover_hil.tune.metrics import TruePath, path_rms_m

ROOT = Path(__file__).parents[2]
OF_SCOMP = "controllers.slip.scomp"
OF_CAMERA = "controllers.estimation.ground."
NUMBERS_OF_CAMERA = (
    "estimation.parameters.GroundParameters.slip_sd",
    "estimation.parameters.GroundParameters.noise_m_sqrt_m",
    "safety.entrapment.LEAST_ASIDE",
    "safety.entrapment.LEAST_GROUND_PROGRESS",
    "safety.entrapment.EntrapmentSettings.entrapment_ground_m",
)
OF_TRACE = "controllers.ftrace"
OF_HOUGH = ("ftrace.hough", "ftrace.parameters.HoughParameters", "ftrace.parameters.FuzzyParameters")
TRACE_DRIVES = ROOT.parent / "shared" / "data" / "trace_drives"
FIGURES_OF_TRACE = {"hold_rms_deg": "hold, deg", "long_missed_pct": "missed, %", "within_pct": "within, %"}
LEAST_CHANGE = 0.005
"""Of a figure of the trace."""
SHORT_DRIVES = ("curved_104", "dropout_104")
FOLDERS = ("controllers/slip", "controllers/estimation", "controllers/safety", "controllers/ftrace")
PACKAGES = ("controllers.", "rover_hil.gap.", "sim_backends.")
SITE = 500
CONFIGURE = load_config
CORNERS = RectangleMission(type="rectangle", length_m=0.9, width_m=0.4).corners()


@dataclass(frozen=True, slots=True)
class Number:
    """A number in a file.

    Attributes:
        module: Name of its module.
        owner: Class whose default it is; empty where it is the module's own.
        name: Its name there.
        text: Its value as written.
    """

    module: str
    owner: str
    name: str
    text: str

    @property
    def title(self) -> str:
        """Its name in the table."""
        return ".".join(
            part for part in (self.module.removeprefix("controllers."), self.owner, self.name) if part
        )


def numbers(root: Path = ROOT, folders: Sequence[str] = FOLDERS) -> Iterator[Number]:
    """Yield every number of the folders: constants of modules, and defaults of parameters and settings."""
    for folder in folders:
        for path in sorted((root / folder).rglob("*.py")):
            module = ".".join(path.relative_to(root).with_suffix("").parts)
            tree = ast.parse(path.read_text(encoding="utf-8"))
            for name, value in _assigned(tree):
                yield Number(module, "", name, ast.unparse(value))
            for node in tree.body:
                if isinstance(node, ast.ClassDef) and node.name.endswith(("Parameters", "Settings", "Map")):
                    for name, value in _assigned(node):
                        yield Number(module, node.name, name, ast.unparse(value))


def _assigned(node: ast.Module | ast.ClassDef) -> Iterator[tuple[str, ast.expr]]:
    for statement in node.body:
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            name, value = statement.targets[0].id, statement.value
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            name, value = statement.target.id, statement.value or ast.Constant(None)
        else:
            continue
        if _is_number(value):
            yield name, value


def _is_number(node: ast.expr) -> bool:
    """Return whether an expression is arithmetic and holds a number other than 0."""
    parts = [part for part in ast.walk(node) if isinstance(part, ast.Constant)]
    kinds = (
        ast.Constant,
        ast.BinOp,
        ast.UnaryOp,
        ast.operator,
        ast.unaryop,
        ast.Call,
        ast.Attribute,
        ast.Name,
        ast.Load,
    )
    is_arithmetic = all(isinstance(part, kinds) for part in ast.walk(node))
    return is_arithmetic and any(type(part.value) in (int, float) and part.value for part in parts)


class NotSetError(ValueError):
    """No section of the configuration has the setting."""


@contextmanager
def changed(number: Number, factor: float) -> Iterator[None]:
    """Give a number another value for a while; every user that reads it from its place sees it."""
    module = importlib.import_module(number.module)
    if not number.owner:
        usual = getattr(module, number.name)
        loaded = [each for name, each in sys.modules.items() if name.startswith(PACKAGES)]
        holders = [each for each in loaded if vars(each).get(number.name) is usual]  # imported by name, too
        for holder in holders:
            setattr(holder, number.name, varied(usual, factor))
        try:
            yield
        finally:
            for holder in holders:
                setattr(holder, number.name, usual)
        return
    owner = getattr(module, number.owner)
    if not is_dataclass(owner):
        with mock.patch.object(missions, "load_config", partial(_configured, owner, number.name, factor)):
            yield
        return
    group = next(each for each in _groups(module) if type(each) is owner)
    usual = getattr(group, number.name)
    object.__setattr__(group, number.name, varied(usual, factor))
    try:
        yield
    finally:
        object.__setattr__(group, number.name, usual)


def _configured(owner: type, name: str, factor: float, shipped: str) -> Config:
    """Return a shipped configuration with a setting changed, wherever it has it."""
    config = CONFIGURE(shipped)
    holders = [each for each in _settings(config) if isinstance(each, owner) and vars(each)[name] is not None]
    if not holders:
        raise NotSetError
    for settings in holders:
        vars(settings)[name] = varied(vars(settings)[name], factor)
    return config


def _settings(value: object) -> Iterator[BaseModel]:
    if isinstance(value, BaseModel):
        yield value
        value = vars(value)
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, Sequence) and not isinstance(value, str):
        for part in value:
            yield from _settings(part)


def _groups(module: object) -> Iterator[object]:
    """Yield the groups of numbers in the objects of a module."""
    for value in vars(module).values():
        if is_dataclass(value) and not isinstance(value, type):
            yield value
            yield from (getattr(value, field.name) for field in fields(value))


Figures = dict[str, float]


@cache
def usual_figures() -> Figures:
    """Return the figures as shipped."""
    return figures()


def figures() -> Figures:
    """Return what is watched, in mm; infinite where the mission did not end as it should."""
    driven = drive(robotino(SITE))
    x_m, y_m, yaw_rad = np.array([moment.truth for moment in driven.moments]).T
    path = TruePath(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad)
    is_well = driven.mode is Mode.FINISHED
    return {"path": 1e3 * path_rms_m(path, CORNERS) if is_well else math.inf}


def trace_figures() -> dict[str, float]:
    """Return error of the trace's angle, missed frames, and errors within two of its deviations."""
    results = figures_of_trace(together([fused(TRACE_DRIVES / name) for name in SHORT_DRIVES]))
    return {text: results[name] for name, text in FIGURES_OF_TRACE.items()}


usual_trace_figures = cache(trace_figures)


def trace_changes(number: Number, factors: Sequence[float]) -> str:
    """Return by how much the figures of the trace change at these multiples of a number."""
    if number.title.startswith(OF_HOUGH):
        return "of `hough`"
    if not TRACE_DRIVES.is_dir():
        return "not measured"
    usual, changed_figures = usual_trace_figures(), []
    for factor in factors:
        try:
            with changed(number, factor):
                changed_figures.append(trace_figures())
        except (TypeError, ValueError, IndexError, ArithmeticError, cv2.error):  # a shape or an index
            return "refused"
    return (
        "; ".join(
            f"{name} {' / '.join(_rounded(each[name] - value) for each in changed_figures)}"
            for name, value in usual.items()
            if any(_rounded(each[name] - value) != "0" for each in changed_figures)
        )
        or "0 / 0"
    )


def _rounded(value: float) -> str:
    text = f"{value:+.2g}"
    return text if abs(value) >= LEAST_CHANGE else "0"


def changes(number: Number, factors: Sequence[float] = FACTORS) -> dict[str, str]:
    """Return the row of a number: by how many mm each figure changes at these multiples of it."""
    if number.module.startswith(OF_TRACE):
        return {"path": trace_changes(number, factors)}
    usual = usual_figures()
    if number.module.startswith(OF_SCOMP):
        return dict.fromkeys(usual, "of another rover")
    if number.module.startswith(OF_CAMERA) or number.title in NUMBERS_OF_CAMERA:
        return dict.fromkeys(usual, "no camera")
    results: list[Figures | str] = []
    for factor in factors:
        try:
            with changed(number, factor):
                results.append(figures())
        except NotSetError:
            results.append("not set")
        except ValueError:  # out of its range
            results.append("refused")
    return {
        name: " / ".join(
            _change(each if isinstance(each, str) else each[name] - usual[name]) for each in results
        )
        for name in usual
    }


def _change(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return "stopped" if math.isinf(value) else f"{value:+.1f}" if abs(value) >= 0.05 else "0"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", help="rows whose names begin so; default: all")
    parser.add_argument("--factors", type=float, nargs=2, default=FACTORS, help="default: 0.8 1.2")
    arguments = parser.parse_args()
    chosen = tuple(arguments.only or ("",))
    every, day = [number for number in numbers() if number.title.startswith(chosen)], wall_time_text()
    today = f"{day[:4]}-{day[4:6]}-{day[6:8]}"
    with open_executor() as pool:
        print("| number | value | path, mm | date |")
        print("|---|---|---|---|")
        rows = track(
            pool.map(partial(changes, factors=arguments.factors), every),
            total=len(every),
            console=Console(stderr=True),
        )
        for number, row in zip(every, rows, strict=True):
            cells = [number.title, number.text, *row.values(), today]
            print(f"| {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
