"""Usual ways to choose effects, asked for the same cases: stepwise BIC, lasso with cross-validation, SINDy.

They get the same whitened residual of the fitted base model and the same changes by the effects, each at its
best shape and after base parameters have taken out what they can absorb; only the choice is theirs.
"""

import importlib.util
import math

import numpy as np
from numpy.typing import NDArray

from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.evidence.score import Projection
from rover_hil.gap.search.search import best_shapes

Floats = NDArray[np.float64]
FOLDS = 5
THRESHOLD = 0.1
"""Of SINDy's sequential thresholding, in natural sizes of the effects: its default."""


def ask_peers(findings: MachineFindings) -> dict[str, tuple[str, ...]]:
    """Return the effects that each peer names; peers that are not installed are left out."""
    scores = best_shapes(findings.scores)
    names = [item.direction.name for item in scores]
    target = Projection(findings.base.fit).residual
    unit = np.stack([item.projected for item in scores], axis=1)
    sizes = np.array([item.direction.size / item.standard_error for item in scores])
    natural = unit * sizes
    chosen = {"stepwise BIC": _stepwise(unit, target)}
    if importlib.util.find_spec("sklearn") is not None:
        chosen["lasso, 5-fold"] = _lasso(unit, target)
    if importlib.util.find_spec("pysindy") is not None:
        chosen["SINDy (STLSQ)"] = _sindy(natural, target)
    return {peer: tuple(sorted(names[index] for index in picked)) for peer, picked in chosen.items()}


def _stepwise(columns: Floats, target: Floats) -> list[int]:
    """Return what forward and backward steps choose by BIC, the size of the errors unknown."""
    chosen: list[int] = []
    best = _bic(columns, target, chosen)
    while True:
        moves = [[*chosen, new] for new in range(columns.shape[1]) if new not in chosen]
        moves += [[one for one in chosen if one != gone] for gone in chosen]
        values = [_bic(columns, target, move) for move in moves]
        if not values or min(values) >= best - 1e-9:
            return chosen
        best, chosen = min(values), moves[int(np.argmin(values))]


def _bic(columns: Floats, target: Floats, chosen: list[int]) -> float:
    left = target
    if chosen:
        part = columns[:, chosen]
        left = target - part @ np.linalg.lstsq(part, target, rcond=None)[0]
    return target.size * math.log(float(left @ left) / target.size) + len(chosen) * math.log(target.size)


def _lasso(columns: Floats, target: Floats) -> list[int]:
    from sklearn.linear_model import LassoCV  # type: ignore[import-untyped]

    order = np.random.default_rng(0).permutation(target.size)
    fitted = LassoCV(cv=FOLDS, fit_intercept=False, max_iter=20_000).fit(columns[order], target[order])
    return [int(index) for index in np.flatnonzero(np.abs(fitted.coef_) > 1e-9)]


def _sindy(columns: Floats, target: Floats) -> list[int]:
    from pysindy.optimizers import STLSQ

    fitted = STLSQ(threshold=THRESHOLD).fit(columns, target)
    return [int(index) for index in np.flatnonzero(np.ravel(fitted.coef_))]
