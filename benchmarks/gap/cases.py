"""Labelled cases of hidden effects on a side slope: what is hidden, how clearly it shows, and its data.

How clearly an effect shows (SNR) is what one run shows of it on average, over the scatter of one run, all
channels together, after base parameters as uncertain as tables are have imitated what they can: were nothing
else unknown, the runs that are learned from would show it at SNR times the root of their number, 45, in
standard deviations. It is computed from nature alone. Laws of nature (onset and softness of flowing soil,
powers of mass and slip) are drawn anew for each case, apart from those of the cards.
"""

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rover_hil.gap.data.readers.side_slope import read_side_slope
from sim_backends.models.interface import Run
from tests.nature.side_slope import PERTURBED, Experiment, Nature, some_nature, write

SINGLES = {
    "slope_failure": {"flow": 0.0025},
    "friction_angle": {"friction": -2.5},
    "shear_modulus": {"shear": 0.006},
    "sinkage_modulus": {"bearing": 25.0},
    "cog_offset": {"lateral": -0.025},
    "heading_drift": {"drift": -2.0},
    "heading_offset": {"heading": -1.2},
    "camera_yaw": {"camera": -1.2},
    "grouser_radius": {"grousers": 0.0025},
    "slip_sinkage": {"digging": 0.02},
    "wheel_radius": {"radius": -0.003},
}
PAIRS = (
    ("slope_failure", "wheel_radius"),
    ("slope_failure", "sinkage_modulus"),
    ("heading_drift", "slip_sinkage"),
    ("camera_yaw", "shear_modulus"),
    ("cog_offset", "heading_drift"),
    ("friction_angle", "slope_failure"),
    ("heading_offset", "sinkage_modulus"),
    ("cog_offset", "wheel_radius"),
)
OUTSIDE = {
    "tether": {"tether": 8.0},
    "side_pull": {"side_pull": 8.0},
    "trampled": {"trampled": 0.25},
    "edges": {"edges": 1.2},
    "heat": {"heat": 0.08},
}
BOTH_SIGNS = ("friction", "shear", "lateral", "drift", "heading", "camera", "radius")
NOISES = ("white", "ar", "heavy", "quantised")
SNR = {"single": (1.0, 1.5, 2.0, 3.0, 5.0), "pair": (1.5, 2.0, 3.0, 5.0), "outside": (2.0, 3.0, 5.0)}
BLOCK = {"none": 8, "single": 6, "pair": 3, "outside": 3}
"""Cases of each kind in twenty."""
Table = NDArray[np.float64]
LEAST, MOST = 0.05, 12.0
REPETITIONS = 4
STEPS = 4
LEARNED = 45
"""Runs that are not locked, of 60."""


@dataclass(frozen=True)
class Case:
    """What is hidden.

    Attributes:
        kind: none, single, pair or outside.
        names: The hidden effects.
        snr: How clearly each shows.
        noise: Kind of the errors.
        seed: Of everything drawn.
    """

    kind: str
    names: tuple[str, ...]
    snr: float
    noise: str
    seed: int


def cases(first: int, count: int) -> list[Case]:
    """Return cases; every block of twenty holds all kinds, and every number always the same case."""
    return [_case(number) for number in range(first, first + count)]


def _case(number: int) -> Case:
    kinds = [(kind, index) for kind, share in BLOCK.items() for index in range(share)]
    block, place = divmod(number, len(kinds))
    kind, index = kinds[place]
    turn = block * BLOCK[kind] + index
    noise = NOISES[turn % 4] if kind == "none" else str(np.random.default_rng(number).choice(NOISES))
    if kind == "none":
        return Case(kind, (), 0.0, noise, number)
    known: dict[str, list[tuple[str, ...]]] = {
        "single": [(name,) for name in SINGLES],
        "pair": list(PAIRS),
        "outside": [(name,) for name in OUTSIDE],
    }
    names = known[kind]
    levels = SNR[kind]
    return Case(kind, names[turn % len(names)], levels[turn // len(names) % len(levels)], noise, number)


def make_nature(case: Case) -> Nature:
    """Draw a nature in which the effects of a case show as clearly as asked."""
    rng = np.random.default_rng(90_000 + case.seed)
    laws = {
        "flow_onset": rng.uniform(4.0, 11.0) - 8.0,
        "flow_softness": float(rng.choice([0.1, 0.7, 3.0])) - 0.7,
        "flow_load": rng.uniform(0.0, 1.2) - 1.0,
        "flow_back": rng.uniform(0.0, 0.7) - 0.4,
        "drift_load": rng.uniform(0.0, 2.0) - 1.5,
        "digging_power": rng.uniform(0.7, 1.3) - 1.0,
    }
    hidden: dict[str, float] = {}
    for name in case.names:
        unit = (OUTSIDE if case.kind == "outside" else SINGLES)[name]
        sign = float(rng.choice([-1.0, 1.0])) if set(unit) <= set(BOTH_SIGNS) else 1.0
        signed = {key: sign * value for key, value in unit.items()}
        scale = _scale_for(case.snr, case.noise, signed, laws)
        hidden |= {key: scale * value for key, value in signed.items()}
    return some_nature(rng, **laws, **hidden)


def make_runs(case: Case) -> tuple[Nature, list[Run]]:
    """Return the nature of a case and what is measured in it."""
    nature = make_nature(case)
    return nature, _measure(nature, Experiment(kind=case.noise), 10_000 + case.seed)


def _scale_for(snr: float, noise: str, unit: Mapping[str, float], laws: Mapping[str, float]) -> float:
    """Return by what to multiply an effect so that it shows as clearly as asked."""
    scale = 1.0
    for _ in range(STEPS):
        found = _snr(noise, {key: scale * value for key, value in unit.items()}, laws)
        # Damped, because effects grow between linearly and with their square.
        scale = float(np.clip(scale * (snr / max(found, 1e-6)) ** 0.7, LEAST, MOST))
    return scale


def _snr(noise: str, hidden: Mapping[str, float], laws: Mapping[str, float]) -> float:
    change = ((_still({**laws, **hidden}) - _nothing_hidden()) / _scatter(noise)).ravel()
    imitations = np.stack([(one / _scatter(noise)).ravel() for one in _base_changes()], axis=1)
    root = math.sqrt(LEARNED / len(_nothing_hidden()))
    matrix = np.vstack((root * imitations, np.eye(imitations.shape[1])))
    target = np.concatenate((root * change, np.zeros(imitations.shape[1])))
    left = target - matrix @ np.linalg.lstsq(matrix, target, rcond=None)[0]
    return float(np.linalg.norm(left)) / math.sqrt(LEARNED)


@cache
def _base_changes() -> list[Table]:
    """Return what base parameters change that are off by what tables leave open."""
    return [_still({name: spread}) - _nothing_hidden() for name, spread in PERTURBED.items()]


def _still(changes: Mapping[str, float]) -> Table:
    """Return what is measured without errors."""
    still = Experiment(noise=0.0, setting_deg=0.0, replicates=1)
    nature = Nature(**{name: getattr(Nature(), name) + change for name, change in changes.items()})
    return _table(_measure(nature, still, 0))


@cache
def _nothing_hidden() -> Table:
    return _still({})


@cache
def _scatter(noise: str) -> Table:
    """Return the standard deviation of one run about its condition, per channel."""
    runs = _measure(Nature(), Experiment(kind=noise, replicates=REPETITIONS), 1)
    table = _table(runs).reshape(-1, REPETITIONS, len(runs[0].measured))
    return np.asarray(np.sqrt(np.mean(np.var(table, axis=1, ddof=1), axis=0)))


def _table(runs: Sequence[Run]) -> Table:
    return np.array([[float(values[0]) for values in run.measured.values()] for run in runs])


def _measure(nature: Nature, experiment: Experiment, seed: int) -> list[Run]:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), nature, experiment, np.random.default_rng(seed))
        return read_side_slope(Path(folder))
