"""How fast the rover stops when its region crosses the border of its area.

    python -m benchmarks.safety.area_stops [--runs 20] [--rovers robotino el-dorado] [--first 0]

Both shipped rovers, each run as two processes over pseudo-terminals and slcan. The mission lies just inside
an area of random size, a box or a circle, so that the region crosses the border where its uncertainty has
grown. The crossing is found in the log by the points of the 95 % ellipse, without the program's own geometry.
Prints for each run the time from the first cycle whose region is over the border to the first command of
zero that lasts to the end of the log. Exit code 1 where a run had no crossing or that time exceeds 0.3 s.
"""

import argparse
import json
import math
import re
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.program.unplug import run_in_two_processes
from benchmarks.safety.faults.processes import CAMERA, CONFIGS
from drivers.clock import seconds
from rover_hil.config import load_config
from rover_hil.recording.reader import LogReader

BAR_S = 0.3
ROUNDING_M = 1e-5
"""The log is rounded."""
CHI_SQUARE = 5.991464547107979
"""Table value: 95 % of chi-square with two degrees of freedom."""
ANGLES = np.linspace(0.0, 2.0 * np.pi, 4000)

Over = Callable[[NDArray[np.float64], NDArray[np.float64]], float]
"""From points to their greatest excess over a border, in m."""


class Rover(NamedTuple):
    """A shipped rover and a short mission.

    Attributes:
        body_m: Radius of its body.
        mission: What is replaced in its configuration, and by what.
        corners: Of the mission.
        duration_s: Of the run.
    """

    body_m: float
    mission: tuple[str, str]
    corners: tuple[tuple[float, float], ...]
    duration_s: float


ROVERS = {
    "robotino": Rover(
        math.hypot(0.125, 0.04),
        ("length_m = 0.9", "length_m = 0.9"),
        ((0.0, 0.0), (0.9, 0.0), (0.9, 0.4), (0.0, 0.4)),
        14.0,
    ),
    "el-dorado": Rover(
        math.hypot(0.33, 0.092), ("length_m = 3.0", "length_m = 0.8"), ((0.0, 0.0), (0.8, 0.0)), 24.0
    ),
}


def make_area(rover: Rover, rng: np.random.Generator) -> tuple[str, Over]:
    """Return the lines of a random area around a mission, and what measures the excess over its border."""
    margin_m = rover.body_m + float(rng.uniform(0.01, 0.03))
    xs, ys = (np.array(values) for values in zip(*rover.corners, strict=True))
    if rng.integers(2):
        left, right, bottom, top = (
            xs.min() - margin_m,
            xs.max() + margin_m,
            ys.min() - margin_m,
            ys.max() + margin_m,
        )
        text = f"[[{left}, {bottom}], [{right}, {bottom}], [{right}, {top}], [{left}, {top}]]"
        lines = f'\n[safety.area]\ntype = "polygon"\npoints_m = {text}\n'
        return lines, lambda x, y: float(
            max((x - right).max(), (left - x).max(), (y - top).max(), (bottom - y).max())
        )
    x_m, y_m = float(xs.mean()), float(ys.mean())
    radius_m = float(np.hypot(xs - x_m, ys - y_m).max()) + margin_m
    lines = f'\n[safety.area]\ntype = "circle"\ncentre_m = [{x_m}, {y_m}]\nradius_m = {radius_m}\n'
    return lines, lambda x, y: float(np.hypot(x - x_m, y - y_m).max() - radius_m)


def measure(log_path: Path, rover: Rover, over: Over) -> dict[str, object]:
    """Return when the region crossed the border, and how long it took to the last first command of zero."""
    crossed_ns: int | None = None
    zero_ns: int | None = None
    waits, moved_s = False, 0.0
    for message in LogReader(log_path).messages():
        if message.topic == "/estimate":
            record = message.json()
            assert isinstance(record, dict)
            if crossed_ns is None and _over_m(record["estimate"], rover.body_m, over) > ROUNDING_M:
                crossed_ns = message.t_ns
            waits = record.get("waits_for_operator", False)
        elif message.topic == "/command":
            record = message.json()
            assert isinstance(record, dict)
            is_zero = not any(record["speed_rad_s"])
            if crossed_ns is None:
                moved_s += not is_zero
            elif is_zero:
                zero_ns = zero_ns or message.t_ns
            else:
                zero_ns = None
    after_s = None if crossed_ns is None or zero_ns is None else round(seconds(zero_ns - crossed_ns), 3)
    is_reached = after_s is not None and after_s <= BAR_S and waits and moved_s > 0.0
    return {"has_crossed": crossed_ns is not None, "zero_after_s": after_s, "waits": waits, "ok": is_reached}


def _over_m(estimate: dict[str, object], body_m: float, over: Over) -> float:
    numbers = estimate["covariance"]
    assert isinstance(numbers, list)
    xx, xy, _, yy, _, _ = numbers
    values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
    sizes = np.sqrt(CHI_SQUARE * np.maximum(values, 0.0))
    x, y = vectors @ (sizes[:, None] * np.array([np.cos(ANGLES), np.sin(ANGLES)]))
    return over(x + estimate["x_m"], y + estimate["y_m"]) + body_m


def main() -> int:
    """Print the figures as JSON lines; exit code 1 where a bar is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--rovers", nargs="+", choices=ROVERS, default=list(ROVERS))
    parser.add_argument("--first", type=int, default=0, help="seed of the first run")
    arguments = parser.parse_args()
    rows: list[dict[str, object]] = []
    for name in arguments.rovers:
        rover = ROVERS[name]
        for seed in range(arguments.first, arguments.first + arguments.runs):
            lines, over = make_area(rover, np.random.default_rng(seed))
            text = CAMERA.sub("", (CONFIGS / f"{name}.toml").read_text()).replace(*rover.mission)
            with tempfile.TemporaryDirectory() as folder_name:
                folder = Path(folder_name)
                body = "" if "[safety]" in text else f"\n[safety]\narea_body_m = {rover.body_m}\n"
                seeded = re.sub("(?m)^seed = .*", f"seed = {seed}", text)
                (folder / "rover.toml").write_text(seeded + body + lines)
                config = load_config(str(folder / "rover.toml"))
                run_in_two_processes(config, folder, rover.duration_s)
                rows.append({"rover": name, "seed": seed, **measure(folder / "run.mcap", rover, over)})
            print(json.dumps(rows[-1]), flush=True)
    print(f"{sum(row['ok'] is True for row in rows)} of {len(rows)} runs within {BAR_S:g} s")
    return 0 if all(row["ok"] is True for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
