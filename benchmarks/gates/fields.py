"""Field figures of the four-wheel rover, three seeds each, in m."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from benchmarks.four_wheels import field_crab, field_tests, live_loop

FIRST_SEED = 1000
SEEDS = 3


def live(seed: int) -> dict[str, float]:
    """Return the figures of the shipped El-Dorado's loop."""
    with tempfile.TemporaryDirectory() as folder:
        driven = live_loop.drive("shipped", seed, Path(folder) / "run.mcap")
    return {f"live loop, {name}": driven[name] for name in ("estimate_off_m", "end_missed_m", "slip_rms")}


def tests_of_the_paper(seed: int) -> dict[str, float]:
    """Return how far the compensated odometry ends off in both field tests of paper 000."""
    outcomes = field_tests.run_seed(seed, "fused", None)
    return {f"field {name}, final_m": each.scores["ours"]["final_m"] for name, each in outcomes.items()}


def crab(seed: int) -> dict[str, float]:
    """Return how far the rover is from its line where it steers against the slip angle."""
    driven = field_crab.run_seed(seed)
    return {f"crab {name}, final_m": drivers["crab"]["final_m"] for name, drivers in driven.items()}


FIELDS: Mapping[str, Callable[[int], dict[str, float]]] = {
    "live loop": live,
    "field tests": tests_of_the_paper,
    "crab": crab,
}


def measure_field(field: str, seed: int) -> dict[str, float]:
    """Return the figures of a field and one of its seeds."""
    return FIELDS[field](FIRST_SEED + seed)
