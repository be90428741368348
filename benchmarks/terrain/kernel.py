"""How fast wheel forces and steady states are, beside adaptive quadrature of the same integrals.

    python -m benchmarks.terrain.kernel

prints JSON: evaluations per second (one core, best of several runs) and error relative to F_z, of flat wheels
and of wheels at 10 deg camber, for the numpy and the compiled kernel at the bounds 1e-5 and 1e-8, and for
scipy's adaptive quadrature, integral by integral, in the same run; milliseconds per steady state (median and
worst of the paper's four conditions, roll 0 to 20 deg) and for a warm table of these 20; seconds to import.
Slip ratios are even in 0 .. 0.8 and slip angles in +-35 deg; "corner" are those where forces are nearly
singular, s < 0.01 and |beta| < 0.5 deg. Exit code 1 when a bar is missed.
"""

import json
import math
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.terrain.adaptive_wheel import AdaptiveWheel
from sim_backends.terramechanics.slope.rover import Conditions, paper_rover
from sim_backends.terramechanics.slope.steady_state import solve_steady_state
from sim_backends.terramechanics.soil.compiled import load_compiled
from sim_backends.terramechanics.soil.library import load_soil, load_wheel
from sim_backends.terramechanics.soil.numpy_kernel import numpy_kernel
from sim_backends.terramechanics.soil.quadrature import rule_for
from sim_backends.terramechanics.soil.wheel_contact import Kernel, wheel_contact

Floats = NDArray[np.float64]
CAMBER_RAD = math.radians(10.0)
WHEELS = 20_000
CAMBERED_WHEELS = 3_000
CHECKED = 12
RUNS = 7
CONDITIONS = ((10, 23.8), (15, 23.8), (20, 23.8), (20, 33.8))
ROLLS_DEG = (0, 5, 10, 15, 20)
BARS = {
    "numpy_flat_per_s": 400e3,
    "compiled_flat_per_s": 1.5e6,
    "compiled_cambered_per_s": 300e3,
    "compiled_steady_state_ms": 0.5,
    "numpy_steady_state_ms": 30.0,
    "compiled_table_of_20_s": 0.1,
    "import_s": 0.5,
}
SOIL, WHEEL = load_soil("toyoura"), load_wheel("paper_001")


class Motion(NamedTuple):
    """Sinkages, slip ratios and slip angles of many wheels."""

    sinkage_m: Floats
    slip: Floats
    angle_rad: Floats


def motion(generator: np.random.Generator, count: int, *, corner: bool) -> Motion:
    sinkage = generator.uniform(0.008, 0.04, count)
    if corner:
        slip = generator.uniform(0.0, 0.01, count)
        return Motion(sinkage, slip, np.radians(generator.uniform(-0.5, 0.5, count)))
    slip = generator.uniform(0.0, 0.8, count)
    return Motion(sinkage, slip, np.radians(generator.uniform(-35.0, 35.0, count)))


def seconds(work: Callable[[], object]) -> float:
    """Return the processor's time of the fastest of several runs."""
    work()
    spent = []
    for _ in range(RUNS):
        start_ns = time.process_time_ns()
        work()
        spent.append(time.process_time_ns() - start_ns)
    return min(spent) / 1e9


def measure(kernel: Kernel, camber_rad: float, bound: float, *, corner: bool) -> dict[str, float]:
    """Return speed and error of a kernel."""
    contact = wheel_contact(WHEEL, SOIL, camber_rad=camber_rad)
    rule = rule_for(bound)
    count = WHEELS if camber_rad == 0.0 else CAMBERED_WHEELS
    sinkage, slip, angle = motion(np.random.default_rng(1), count, corner=corner)
    side_speed = (1.0 - slip) * np.tan(angle)
    spent_s = seconds(lambda: kernel(contact, rule, sinkage, slip, side_speed))
    measured: dict[str, float] = {"per_s": round(count / spent_s)}
    if bound > 1e-8:
        forces = kernel(contact, rule, sinkage, slip, side_speed)
        exact = kernel(contact, rule_for(1e-8), sinkage, slip, side_speed)
        error = np.abs(forces - exact)[:, :3] / exact[:, 2:3]
        measured["error"] = float(f"{error.max():.1e}")
    return measured


def measure_adaptive(camber_rad: float) -> dict[str, float]:
    """Return speed of adaptive quadrature, and how far the kernel at 1e-8 is from it."""
    peer = AdaptiveWheel(WHEEL, SOIL, camber_rad=camber_rad, tolerance=1e-10 if camber_rad == 0.0 else 1e-7)
    states = motion(np.random.default_rng(1), CHECKED, corner=False)
    start_ns = time.process_time_ns()
    exact = np.array([peer.forces(*map(float, state)) for state in zip(*states, strict=True)])
    spent_s = (time.process_time_ns() - start_ns) / 1e9
    contact = wheel_contact(WHEEL, SOIL, camber_rad=camber_rad)
    side_speed = (1.0 - states.slip) * np.tan(states.angle_rad)
    forces = numpy_kernel(contact, rule_for(1e-8), states.sinkage_m, states.slip, side_speed)
    error = np.abs(forces - exact)[:, :3] / exact[:, 2:3]
    return {"per_s": round(CHECKED / spent_s, 1), "kernel_differs_by": float(f"{error.max():.1e}")}


def steady_states(kernel: Kernel, bound: float) -> dict[str, float]:
    """Return milliseconds per steady state of the paper's tables."""
    spent_ms = []
    for slope_deg, mass_kg in CONDITIONS:
        rover = paper_rover(mass_kg)
        for roll_deg in ROLLS_DEG:
            at = Conditions(math.radians(slope_deg), math.radians(roll_deg))
            solve = partial(solve_steady_state, rover, SOIL, at, bound=bound, kernel=kernel)
            spent_ms.append(1e3 * seconds(solve))
    return {
        "median_ms": round(float(np.median(spent_ms)), 3),
        "worst_ms": round(max(spent_ms), 3),
        "table_of_20_s": round(sum(spent_ms) / 1e3, 4),
    }


def import_seconds() -> float:
    """Return how long a new interpreter takes to import rover and solver."""
    code = "import time; t = time.process_time(); import {0}; print(time.process_time() - t)"
    command = [sys.executable, "-c", code.format("sim_backends.terramechanics.slope.steady_state")]
    spent = [subprocess.run(command, capture_output=True, check=True) for _ in range(5)]
    return min(float(process.stdout) for process in spent)


def main() -> int:
    compiled = load_compiled(lambda line: print(line, file=sys.stderr))
    report: dict[str, object] = {}
    values: dict[str, float] = {"import_s": round(import_seconds(), 3)}
    for name, kernel in (("numpy", numpy_kernel), ("compiled", compiled)):
        for shape, camber in (("flat", 0.0), ("cambered", CAMBER_RAD)):
            for bound in (1e-5, 1e-8):
                measured = measure(kernel, camber, bound, corner=False)
                report[f"{name}, {shape}, bound {bound:g}"] = measured
                if bound == 1e-5:
                    values[f"{name}_{shape}_per_s"] = measured["per_s"]
            report[f"{name}, {shape}, corner, bound 1e-05"] = measure(kernel, camber, 1e-5, corner=True)
        for bound in (1e-8, 1e-5):
            states = steady_states(kernel, bound)
            report[f"{name}, steady states, bound {bound:g}"] = states
        values[f"{name}_steady_state_ms"] = states["median_ms"]
        values[f"{name}_table_of_20_s"] = states["table_of_20_s"]
    for shape, camber in (("flat", 0.0), ("cambered", CAMBER_RAD)):
        report[f"adaptive quadrature, {shape}"] = measure_adaptive(camber)
    missed = [
        bar
        for bar, limit in BARS.items()
        if (values[bar] < limit if bar.endswith("per_s") else values[bar] > limit)
    ]
    print(json.dumps({"figures": report, "values": values, "bars": BARS, "missed": missed}, indent=2))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
