"""The dynamic Robotino against measured runs in steady state, and how fast it computes.

    python -m benchmarks.robotino.plant ../shared/data/robotino_2023 [--cells]
        [--earlier ../shared/data/robotino_2021]

A cell is one measured run (BrOleg5/research-wheel-slippage): surface, commanded speed, direction. The
simulated rover gets the same setpoints on an even floor. A cell counts when mean motor current and true
speed are both within 15 per cent. The surfaces were fitted to the directions 0, 20, 40 ... degrees
(`benchmarks.robotino.fit`); the directions 10, 30, 50 ... are the check. `--cells` lists every cell,
`--earlier` adds the blue and red runs of 2021, outside the count.

The speed is measured with a command and a look at the truth every 20 ms, and without. Beside it: scipy's
LSODA on the same equations without tick counting (`benchmarks.robotino.peer`).
"""

import argparse
import cmath
import json
import math
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.robotino.cells import Cell, measured_cells, measured_cells_2021, simulated
from benchmarks.robotino.fit import CENTRE_OF_MASS_2021_M, RED_SINKAGE_M, used_for_fitting
from benchmarks.robotino.peer import run_peer
from drivers.clock import NANOSECONDS_PER_SECOND, seconds, stopwatch_ns
from sim_backends.plants.robotino.plant import RobotinoPlant
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.robotino.site import load_site
from sim_backends.plants.robotino.surfaces import shipped_surfaces

TOLERANCE = 0.15
SHARE_BAR = 0.80
SPEED_BAR = 100.0
Pair = tuple[Cell, Cell]


def is_within(pair: Pair) -> bool:
    """Return whether mean current and true speed of a cell are both within 15 per cent of the measured."""
    measured, model = pair
    current = model.current_a.mean() / measured.current_a.mean() - 1.0
    speed = model.true_speed_m_s / measured.true_speed_m_s - 1.0
    return bool(abs(current) <= TOLERANCE and abs(speed) <= TOLERANCE)


def share_within(pairs: Sequence[Pair]) -> float:
    """Return the share of cells that count."""
    return round(sum(is_within(pair) for pair in pairs) / len(pairs), 3)


def wheel_share(pairs: Sequence[Pair]) -> float:
    """Return the share of wheel currents that are off by at most 15 per cent of their cell's mean current."""
    errors = [abs(model.current_a - cell.current_a) / cell.current_a.mean() for cell, model in pairs]
    return round(float(np.mean(np.concatenate(errors) <= TOLERANCE)), 3)


def row(pairs: Sequence[Pair]) -> dict[str, object]:
    """Return the means of a surface at a commanded speed, measured and simulated."""

    def means(cells: Sequence[Cell]) -> dict[str, float]:
        return {
            "true_speed_m_s": round(statistics.mean(cell.true_speed_m_s for cell in cells), 4),
            "current_a": round(statistics.mean(float(cell.current_a.mean()) for cell in cells), 3),
            "slip": round(statistics.mean(cell.slip for cell in cells), 3),
        }

    return {
        "cells": len(pairs),
        "measured": means([measured for measured, _ in pairs]),
        "simulated": means([model for _, model in pairs]),
        "share_within": share_within(pairs),
        "course_off_deg": root_mean_square([course_off_deg(pair) for pair in pairs]),
        "yaw_rate_off_rad_s": root_mean_square(
            [float(model.velocity[2] - measured.velocity[2]) for measured, model in pairs]
        ),
    }


def course_off_deg(pair: Pair) -> float:
    """Return by how much the simulated rover goes another way, -180 to 180 degrees."""
    measured, model = (complex(cell.velocity[0], cell.velocity[1]) for cell in pair)
    return math.degrees(cmath.phase(model / measured))


def root_mean_square(values: Sequence[float]) -> float:
    """Return the root of the mean of the squares, rounded."""
    return round(math.sqrt(statistics.mean(value * value for value in values)), 3)


def rows(pairs: Sequence[Pair]) -> dict[str, object]:
    """Return a row for each surface and commanded speed."""
    groups: dict[str, list[Pair]] = {}
    for pair in pairs:
        groups.setdefault(f"{pair[0].surface} {pair[0].speed_m_s:g} m/s", []).append(pair)
    return {name: row(group) for name, group in groups.items()}


def listed(pair: Pair) -> dict[str, object]:
    """Return everything about one cell."""

    def numbers(cell: Cell) -> dict[str, object]:
        return {
            "true_speed_m_s": round(cell.true_speed_m_s, 4),
            "course_deg": round(math.degrees(math.atan2(cell.velocity[1], cell.velocity[0])), 1),
            "yaw_rate_rad_s": round(float(cell.velocity[2]), 3),
            "current_a": np.round(cell.current_a, 3).tolist(),
            "mean_current_a": round(float(cell.current_a.mean()), 3),
            "slip": round(cell.slip, 3),
        }

    measured, model = pair
    name = f"{measured.surface} {measured.speed_m_s:g} m/s {measured.direction_deg} deg"
    return {
        "cell": name,
        "measured": numbers(measured),
        "simulated": numbers(model),
        "within": is_within(pair),
    }


def times_real_time(cycle_ns: int, simulated_s: int = 200) -> float:
    """Return how many times faster than real time the plant is, driving back and forth over a site.

    Args:
        cycle_ns: How often it gets setpoints and is asked for the truth.
        simulated_s: For how long.
    """
    settings = RobotinoPlantSettings(site=load_site("paper_like"))
    plant = RobotinoPlant(settings, np.random.default_rng(1), NANOSECONDS_PER_SECOND)
    start_ns = 2 * NANOSECONDS_PER_SECOND
    plant.advance(start_ns)  # compiles
    end_ns = start_ns + simulated_s * NANOSECONDS_PER_SECOND
    started_ns = stopwatch_ns()
    for t_ns in range(start_ns, end_ns, cycle_ns):
        way = 1.0 if t_ns // (5 * NANOSECONDS_PER_SECOND) % 2 else -1.0
        plant.set_wheel_speeds((-3.0 * way, 0.0, 3.0 * way))
        plant.advance(t_ns + cycle_ns)
        plant.truth()
    return simulated_s / seconds(stopwatch_ns() - started_ns)


def how_fast(pairs: Sequence[Pair]) -> tuple[float, dict[str, object]]:
    """Return how many times faster than real time the plant is, and all figures, the peer's included."""
    surfaces = shipped_surfaces()
    asked = [times_real_time(20_000_000) for _ in range(5)]
    alone = [times_real_time(5 * NANOSECONDS_PER_SECOND) for _ in range(5)]
    some = pairs[::40]
    peers = [run_peer(cell, surfaces[cell.surface], 3.0) for cell, _ in some]
    differences = [
        math.hypot(*(model.velocity - velocity)[:2]) / model.true_speed_m_s
        for (_, model), (_, velocity) in zip(some, peers, strict=True)
    ]
    median = statistics.median(asked)
    figures: dict[str, object] = {
        "times_real_time": {
            "median": round(median),
            "min": round(min(asked)),
            "median_undisturbed": round(statistics.median(alone)),
            "bar": SPEED_BAR,
        },
        "peer_scipy_lsoda": {
            "times_real_time": round(statistics.median(times for times, _ in peers)),
            "largest_difference_of_true_speed": round(max(differences), 4),
        },
    }
    return median, figures


def earlier_pairs(folder: Path, scale_mm_per_px: float) -> list[Pair]:
    """Return the straight runs of 2021, measured and simulated with the load of that time."""
    surfaces = shipped_surfaces()
    sinkage_m = {"blue": 0.0, "red": RED_SINKAGE_M}
    return [
        (cell, simulated(cell, surfaces[cell.surface], sinkage_m[cell.surface], CENTRE_OF_MASS_2021_M))
        for cell in measured_cells_2021(folder, scale_mm_per_px)
        if cell.speed_m_s > 0
    ]


def main() -> int:
    """Print the figures as JSON; exit code 1 when a bar is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--cells", action="store_true", help="list every cell")
    parser.add_argument("--earlier", type=Path, help="folder with the blue and red runs of 2021")
    arguments = parser.parse_args()
    scale, cells = measured_cells(arguments.data)
    surfaces = shipped_surfaces()
    pairs = [(cell, simulated(cell, surfaces[cell.surface])) for cell in cells]
    report: dict[str, object] = {"scale_mm_per_px": round(scale, 3), "rows": rows(pairs)}
    earlier = [] if arguments.earlier is None else earlier_pairs(arguments.earlier, scale)
    if earlier:
        report["earlier"] = rows(earlier)
    if arguments.cells:
        report["cells"] = [listed(pair) for pair in (*pairs, *earlier)]
    share = share_within(pairs)
    report["share_within_15_percent"] = {
        "all": share,
        "used_for_fitting": share_within([pair for pair in pairs if used_for_fitting(pair[0])]),
        "check": share_within([pair for pair in pairs if not used_for_fitting(pair[0])]),
        "single_wheel_currents": wheel_share(pairs),
        "bar": SHARE_BAR,
    }
    times, figures = how_fast(pairs)
    print(json.dumps(report | figures, indent=2))
    return 0 if share >= SHARE_BAR and times >= SPEED_BAR else 1


if __name__ == "__main__":
    sys.exit(main())
