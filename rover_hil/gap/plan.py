"""Decisions before the data is used: the locked runs, the effects to test, the error probabilities."""

import ast
import fnmatch
import hashlib
import json
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from drivers.errors import ConfigError
from rover_hil.gap.data.derivatives import Mask
from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.problem import condition_key, is_steady
from sim_backends.models.interface import Array, Model, Run

COMPARISONS: Mapping[type[ast.cmpop], Callable[[float, float], bool]] = {
    ast.Eq: lambda one, other: math.isclose(one, other, abs_tol=1e-9),
    ast.NotEq: lambda one, other: not math.isclose(one, other, abs_tol=1e-9),
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


class TooFewRunsError(ConfigError):
    """There are too few runs to split them for search and validation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The split and the rules.

    Attributes:
        model: Identifier of the model.
        discover: Runs of the search.
        confirm: Runs that stay locked until validation.
        cards: Effects to test.
        alphas: Probabilities of error.
        seed: Of all random numbers.
        data_sha256: Of every measured and set value.
        confirm_rule: The expression that chose the locked runs; empty where the split was drawn.
    """

    model: str
    discover: tuple[str, ...]
    confirm: tuple[str, ...]
    cards: tuple[str, ...]
    alphas: Mapping[str, float]
    seed: int
    data_sha256: str
    confirm_rule: str = ""

    def content(self) -> dict[str, object]:
        """Return the plan as a table, with its hash."""
        table: dict[str, object] = asdict(self)
        table["plan_sha256"] = hashlib.sha256(json.dumps(table, sort_keys=True).encode()).hexdigest()
        return table


def data_hash(runs: Sequence[Run]) -> str:
    """Return a hash of all runs, independent of their files."""
    digest = hashlib.sha256()
    for run in sorted(runs, key=lambda one: one.name):
        digest.update(run.name.encode())
        for name in sorted(run.conditions):
            digest.update(f"{name}={run.conditions[name]!r}".encode())
        for table in (run.inputs, run.measured):
            for name in sorted(table):
                digest.update(name.encode())
                digest.update(np.ascontiguousarray(table[name], dtype=np.float64).tobytes())
    return digest.hexdigest()


def require_runs(runs: Sequence[Run]) -> int:
    """Return the fewest runs that can be split.

    Raises:
        TooFewRunsError: There are fewer.
    """
    least = DATA.runs.least_steady if is_steady(runs) else DATA.runs.least_series
    if len(runs) < least:
        raise TooFewRunsError(
            f"{len(runs)} runs are too few to split them for search and validation: measure {least} or more"
        )
    return least


def make_plan(
    model: Model, runs: Sequence[Run], *, seed: int, confirm: str = "", alphas: Mapping[str, float]
) -> Plan:
    """Split `runs`, independent of measured values.

    Raises:
        ConfigError: The expression is wrong.
        TooFewRunsError: Too few runs on one side.
    """
    least = require_runs(runs)
    steady = is_steady(runs)
    locked = (
        {run.name for run in filter(_compile(confirm), runs)}
        if confirm
        else _drawn(model, runs, np.random.default_rng(seed), steady)
    )
    discover = tuple(run.name for run in runs if run.name not in locked)
    if confirm and (not locked or len(discover) < least // 2 + 1):
        raise TooFewRunsError(
            f"--confirm '{confirm}' locks {len(locked)} of {len(runs)} runs: leave some on both sides"
        )
    return Plan(
        model=model.name,
        discover=discover,
        confirm=tuple(run.name for run in runs if run.name in locked),
        cards=tuple(card.name for card in model.effects),
        alphas=dict(alphas),
        seed=seed,
        data_sha256=data_hash(runs),
        confirm_rule=confirm,
    )


def _drawn(model: Model, runs: Sequence[Run], rng: np.random.Generator, steady: bool) -> set[str]:
    groups: dict[tuple[float, ...], list[str]] = {}
    for run in runs:
        key = condition_key(model, run)
        groups.setdefault(key, []).append(run.name)
    if len(groups) < DATA.plan.least_groups:
        return _single_runs(groups, rng)
    target = DATA.plan.locked_share * len(runs)
    conditions = np.array(list(groups))
    levels = [set(column) for column in conditions.T]
    needed = [one if len(one) <= DATA.plan.few_levels else set() for one in levels]
    kept = np.ones(len(conditions), dtype=bool)
    locked: set[str] = set()
    for index in rng.permutation(len(conditions)):
        members = list(groups.values())[index]
        if len(locked) + len(members) > target + 0.5 * len(members):
            continue
        if steady and (_is_corner(conditions, index) or not _levels_kept(conditions, kept, index, needed)):
            continue
        kept[index] = False
        locked.update(members)
    return locked or _single_runs(groups, rng)


def _single_runs(groups: Mapping[tuple[float, ...], Sequence[str]], rng: np.random.Generator) -> set[str]:
    """Lock single runs where there are too few groups to lock whole ones."""
    count = sum(len(members) for members in groups.values())
    target = max(1, math.floor(DATA.plan.locked_share * count))
    shuffled = [list(rng.permutation(members)) for members in groups.values()]
    locked: set[str] = set()
    while len(locked) < target:
        members = max(shuffled, key=len)
        locked.add(str(members.pop()))
    return locked


def _levels_kept(conditions: Array, kept: Mask, index: int, needed: Sequence[set[float]]) -> bool:
    others = kept.copy()
    others[index] = False
    return all(level <= set(column) for level, column in zip(needed, conditions[others].T, strict=True))


def _is_corner(conditions: Array, index: int) -> bool:
    low, high = conditions.min(axis=0), conditions.max(axis=0)
    varied = high > low
    here = conditions[index]
    return bool(np.all(((here == low) | (here == high))[varied]))


def _compile(expression: str) -> Callable[[Run], bool]:
    """Return a test of runs; the expression may compare conditions and `run`, whose name takes * and ?."""
    try:
        tree = ast.parse(expression, mode="eval").body
    except SyntaxError as error:
        raise ConfigError(
            f"--confirm '{expression}' is not an expression; write one like 'slope_deg >= 20'"
        ) from error

    def rule(run: Run) -> bool:
        return bool(_value(tree, run, expression))

    return rule


def _value(node: ast.expr, run: Run, text: str) -> float | str | bool:
    match node:
        case ast.BoolOp(op=ast.And(), values=values):
            return all(_value(one, run, text) for one in values)
        case ast.BoolOp(values=values):
            return any(_value(one, run, text) for one in values)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return not _value(operand, run, text)
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as number)):
            return -float(number)
        case ast.Compare(left=left, ops=ops, comparators=others):
            sides = [_value(one, run, text) for one in (left, *others)]
            return all(
                _holds(op, one, other, text)
                for op, one, other in zip(ops, sides[:-1], sides[1:], strict=True)
            )
        case ast.Constant(value=str() | int() | float() as value):
            return value
        case ast.Name(id="run"):
            return run.name
        case ast.Name(id=name) if name in run.conditions:
            return float(run.conditions[name])
        case ast.Name(id=name):
            known = ", ".join(["run", *run.conditions])
            raise ConfigError(f"--confirm '{text}': run {run.name} has no '{name}'; there is {known}")
    raise ConfigError(f"--confirm '{text}': only comparisons with and, or, not; like 'slope_deg >= 20'")


def _holds(op: ast.cmpop, one: float | str | bool, other: float | str | bool, text: str) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        same = fnmatch.fnmatchcase(str(one), str(other))
        if isinstance(op, ast.Eq | ast.NotEq):
            return same == isinstance(op, ast.Eq)
        raise ConfigError(f"--confirm '{text}': names can only be compared with == and !=")
    if type(op) not in COMPARISONS:
        raise ConfigError(f"--confirm '{text}': compare with ==, !=, <, <=, > or >=")
    return COMPARISONS[type(op)](one, other)
