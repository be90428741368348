"""Torque maps on ground that they know and do not know, with and without the excitation.

    python -m benchmarks.robotino.torque_maps [--seeds 6] [--first 4000] [--only unknown|known]

Drives the rectangle with encoders and gyro, with the slip maps by currents alone, with the excitation alone,
and with both: the excitation rests for up to 4.5 s while the learned curve is valid. Unknown ground: random
patchworks of the shipped surfaces, patchworks and single floors of surfaces with random constants, and
single floors of `tests/nature/omni_contact.py` with three contact laws. Known ground: a floor of each
shipped surface, which is named in `known_surfaces` in the rows with that remark. Slip is judged every cycle
against the true slip of the half second before: wrong is more than 0.1 and more than 3 reported standard
deviations off. Exit code 1 where a map by currents marks wrong slip valid for more than 5 % of the time on
unknown ground, or its path is more than 10 % worse than that of the encoders, root mean square over all.
"""

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.robotino.yaw_probe_faults import Fault, judge_slip, random_constants, spoil
from controllers.safety import Mode
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.link import NoTap
from rover_hil.config import Config, load_config, load_slip_map
from rover_hil.report.tracks import Track
from rover_hil.run.composition import build_virtual_rig
from rover_hil.tune.metrics import TruePath, closure_m, path_rms_m
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.robotino.site import Site, random_site
from sim_backends.plants.robotino.surfaces import Surface
from tests.nature.omni_contact import LAWS, Floor, OmniContact

TIME_LIMIT_S = 90.0
WRONG_BAR, PATH_BAR = 0.05, 1.10
REST = {"use": "yaw_probe", "learn": True, "excitation_rest_s": 4.5}
USES: dict[str, dict[str, object] | None] = {
    "encoders": None,
    "current: surfaces": {"use": "surfaces"},
    "current: linear in M": {"use": "linear_m"},
    "excitation": {"use": "yaw_probe"},
    "both": REST,
}
CURRENT = tuple(name for name in USES if name.startswith("current"))
FLOORS = ("table", "brown", "gray", "green", "blue")


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        finished: Whether the mission was finished.
        path_m, closure_m: Errors of the true path.
        valid, wrong: Shares of the running time with valid slip, and with wrong slip marked valid.
        square: Mean square of the error of valid slip; None without valid slip.
    """

    finished: bool
    path_m: float
    closure_m: float
    valid: float
    wrong: float
    square: float | None


def one_floor(seed: int) -> Site:
    """Return a floor with random constants, the same everywhere."""
    surfaces: dict[str, Surface] = random_constants(seed).surfaces
    return Site(name="one", floor="table", surfaces=surfaces)


def nature_floor(seed: int) -> Floor:
    """Return a floor of the independent rover, the same everywhere, with a random contact law."""
    rng = np.random.default_rng(seed)
    law = LAWS[int(rng.integers(len(LAWS)))]
    slope = math.exp(rng.uniform(math.log(1.2), math.log(25.0)))
    return Floor.uniform(
        law, 0.001, (rng.uniform(0.4, 1.0), slope, rng.uniform(0.005, 0.12), rng.uniform(0.03, 0.3))
    )


GROUNDS: dict[str, Callable[[int], Site | Floor]] = {
    "sites": lambda seed: random_site(np.random.default_rng(seed)),
    "random constants, patches": random_constants,
    "random constants, one floor": one_floor,
    "tests/nature, one floor": nature_floor,
}


def configure(slip: dict[str, object] | None, site: Site, seed: int) -> Config:
    """Return the shipped Robotino on a site, with a table [slip] less its maps."""
    table = load_config("robotino").model_dump(by_alias=True, exclude={"slip"})
    table["loop"]["time_limit_s"] = TIME_LIMIT_S
    if slip is not None:
        table["slip"] = {"maps": load_slip_map("robotino"), **slip}
    config = Config.model_validate(table)
    plant = RobotinoPlantSettings(type="robotino", site=site)
    simulation = config.require_simulation().model_copy(update={"seed": seed, "plant": plant})
    return config.model_copy(update={"simulation": simulation})


def drive(slip: dict[str, object] | None, ground: Site | Floor, seed: int) -> Run:
    """Drive once and judge."""
    config = configure(slip, ground if isinstance(ground, Site) else Site(), seed)
    clock = VirtualClock()
    rig, world = build_virtual_rig(config, clock, NoTap())
    if isinstance(ground, Floor):
        spoil(world, Fault(), OmniContact(ground, clock.now_ns()))
    period_ns = nanoseconds(1.0 / config.loop.rate_hz)
    start_ns = now_ns = clock.now_ns()
    rows: list[tuple[float, ...]] = []
    mode = Mode.SETTLING
    rig.connect(1.0)
    with closing(rig):
        while now_ns < start_ns + nanoseconds(TIME_LIMIT_S) and mode not in (
            Mode.FINISHED,
            Mode.EMERGENCY_STOP,
        ):
            now_ns += period_ns
            clock.sleep_until(now_ns)
            _, output, _ = rig.cycle(now_ns)
            mode, truth = output.mode, world.plant.truth()
            rover = None if output.slip is None else output.slip.rover
            reading = (math.nan, math.nan, 0.0) if rover is None else (rover.slip, rover.sd, not rover.reason)
            pose = (truth.x_m, truth.y_m, truth.yaw_rad)
            moves = (*truth.wheel_position_rad, mode is Mode.RUNNING)
            rows.append((seconds(now_ns - start_ns), *pose, *moves, *reading))
    table = np.array(rows)
    assert config.mission is not None
    path, corners = TruePath.of(Track.of(table[:, :4]).from_first_pose()), config.mission.corners()
    valid, wrong, square, _ = judge_slip(table)
    return Run(
        finished=mode is Mode.FINISHED,
        path_m=path_rms_m(path, corners),
        closure_m=closure_m(path, corners),
        valid=valid,
        wrong=wrong,
        square=square,
    )


def print_row(ground: str, use: str, runs: Sequence[Run]) -> None:
    """Print a row of the table as Markdown."""
    squares = [run.square for run in runs if run.square is not None]
    cells = (
        ground,
        use,
        f"{100 * np.mean([run.valid for run in runs]):.0f}",
        f"{100 * np.mean([run.wrong for run in runs]):.1f}",
        f"{math.sqrt(float(np.mean(squares))):.3f}" if squares else "",
        f"{1e3 * np.median([run.path_m for run in runs]):.0f}",
        f"{1e3 * np.sqrt(np.mean([run.path_m**2 for run in runs])):.0f}",
        f"{1e3 * np.median([run.closure_m for run in runs]):.0f}",
        f"{100 * np.mean([run.finished for run in runs]):.0f}",
    )
    print(f"| {' | '.join(cells)} |", flush=True)


def on_unknown_ground(first: int, seeds: int) -> bool:
    """Print the rows of unknown ground; return whether the bars are reached."""
    by_use: dict[str, list[Run]] = {use: [] for use in USES}
    for ground, make in GROUNDS.items():
        for use, slip in USES.items():
            runs = [drive(slip, make(seed), seed) for seed in range(first, first + seeds)]
            print_row(ground, use, runs)
            by_use[use] += runs
    path_m = {use: math.sqrt(float(np.mean([run.path_m**2 for run in runs]))) for use, runs in by_use.items()}
    wrong = {use: float(np.mean([run.wrong for run in runs])) for use, runs in by_use.items()}
    for use in USES:
        print_row("all of these", use, by_use[use])
    return all(wrong[use] <= WRONG_BAR and path_m[use] <= PATH_BAR * path_m["encoders"] for use in CURRENT)


def on_known_ground(first: int, seeds: int) -> None:
    """Print the rows of known ground."""
    for floor in FLOORS:
        site = Site(name=floor, floor=floor)
        known = {"known_surfaces": [f"{floor}_surface"]}
        uses = dict(USES)
        uses |= {f"{use}, named": {**(USES[use] or {}), **known} for use in (*CURRENT, "both")}
        for use, slip in uses.items():
            run = partial(drive, slip, site)
            print_row(floor, use, [run(seed) for seed in range(first, first + seeds)])


def main() -> int:
    """Print the tables; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--first", type=int, default=4000, help="first seed; below 10 those of development")
    parser.add_argument("--only", choices=("unknown", "known"))
    arguments = parser.parse_args()
    is_right = arguments.only == "known" or on_unknown_ground(arguments.first, arguments.seeds)
    if arguments.only != "unknown":
        on_known_ground(arguments.first, max(1, arguments.seeds // 3))
    return 0 if is_right else 1


if __name__ == "__main__":
    sys.exit(main())
