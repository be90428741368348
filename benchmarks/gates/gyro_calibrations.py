"""`calibrate imu` on contacts that spring and on rigid ones, and missions with what it writes.

    python -m benchmarks.gates.gyro_calibrations [--tries 12] [--floors 60] [--first 500]

A gyro with a gain of 0.985 to 1.02, late by 0 to 20 ms, turns in place on contacts of `tests/nature`: the
firmest floors of four contact laws, and the contacts of `tests/nature/omni_contact` with relaxation lengths
of 3 to 15 mm (springy) and 0.4 mm (rigid). Prints each result, and by how many standard deviations gain and
delay are off. Missions: each gyro with constants of a rigid contact drives floors with them and without them,
with the same noise; the ratio of both paths, and its geometric mean with a 95 % interval.

Exit code 1 where a result beyond three standard deviations is written, fewer than 10 of 12 are written on
rigid contacts, or the upper bound of the mean ratio is above 1.10.
"""

import argparse
import math
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.gates.floors import NATURE_NAMES, configure_version, drive_config
from benchmarks.safety.missions import MakePlant, drive
from controllers.slip.effort.gyro_response import GyroResponse
from drivers.clock import nanoseconds
from drivers.samples import RateSample, Sample
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor
from rover_hil.ready.imu.calibration import GyroCalibration, small_turns_config
from rover_hil.ready.imu.turns import read_turns
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter
from tests.nature.floors import NATURES
from tests.nature.omni_contact import LAWS, Floor, OmniContact

T = TypeVar("T")
RIGID_M = 0.0004
FIRM = 0.05
"""Greatest steady slip of a firm floor."""
MOST_DEVIATIONS, FEWEST_WRITTEN, GREATEST_RATIO = 3.0, 10 / 12, 1.10


@dataclass(frozen=True, slots=True, kw_only=True)
class Gyro:
    """True constants of a gyro."""

    gain: float
    delay_s: float

    @staticmethod
    def draw(seed: int) -> "Gyro":
        """Return the gyro of a seed."""
        rng = np.random.default_rng((seed, 11))
        return Gyro(gain=float(rng.uniform(0.985, 1.02)), delay_s=float(rng.uniform(0.0, 0.02)))

    def falsify(self, _: float, sample: Sample) -> Sample:
        """Return what this gyro makes of a sample."""
        if not isinstance(sample, RateSample):
            return sample
        late_ns = sample.t_ns + nanoseconds(self.delay_s)
        return replace(sample, rate_z_rad_s=self.gain * sample.rate_z_rad_s, t_ns=late_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Try:
    """One calibration: where, of which gyro, and what came of it."""

    ground: str
    seed: int
    gyro: Gyro
    response: GyroResponse
    problem: str

    @property
    def deviations(self) -> float:
        """Greatest error of gain and delay in their standard deviations."""
        found = self.response
        gain = abs(found.gain - self.gyro.gain) / found.gain_sd
        return max(gain, abs(found.delay_s - self.gyro.delay_s) / found.delay_sd_s)

    def __str__(self) -> str:
        found, gyro = self.response, self.gyro
        return (
            f"{self.ground} {self.seed}: gain {found.gain:.3f} +- {found.gain_sd:.3f} (true {gyro.gain:.3f})"
            f", delay {1e3 * found.delay_s:.1f} +- {1e3 * found.delay_sd_s:.1f} ms (true "
            f"{1e3 * gyro.delay_s:.1f}), {self.deviations:.1f} sd; {self.problem[:60] or 'written'}"
        )


def calibrate(ground: str, seed: int) -> Try:
    """Turn on a ground, and return what `calibrate imu` makes of it."""
    gyro, held = Gyro.draw(seed), list[Sample]()

    def take(t_s: float, sample: Sample) -> Sample:
        held.append(gyro.falsify(t_s, sample))
        return held[-1]

    config = small_turns_config(configure_version("shipped", seed))
    drive(config, take, limit_s=config.loop.time_limit_s, make_plant=_plant(ground, seed))
    held.sort(key=lambda sample: sample.t_ns)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "turns.mcap"
        text, files = config.model_dump_json(by_alias=True).encode(), collect_data_files(config)
        with LogWriter(path, held[0].t_ns, text, files, "virtual") as log:
            for sample in held:
                log.samples(sample.t_ns, [sample])
        procedure = GyroCalibration()
        result = procedure.fit(read_turns(path))
    return Try(ground=ground, seed=seed, gyro=gyro, response=result.response, problem=result.problem)


def _plant(ground: str, seed: int) -> MakePlant:
    rng = np.random.default_rng((seed, 12))
    kind, _, law = ground.partition(" ")
    if kind == "rigid":
        floor = Floor.uniform(law, RIGID_M, (0.9, rng.uniform(20.0, 30.0), 0.01, 0.03))
        return lambda start_ns: OmniContact(floor, start_ns)
    if kind == "springy":
        tile = (
            rng.uniform(0.6, 1.0),
            rng.uniform(8.0, 25.0),
            rng.uniform(0.01, 0.03),
            rng.uniform(0.03, 0.1),
        )
        soft = Floor.uniform(law, rng.uniform(0.003, 0.015), tile)
        return lambda start_ns: OmniContact(soft, start_ns)
    nature = next(each for each in NATURES if each.name == ground)
    number = seed
    while nature.steady_slip(nature.draw_floor(number)) > FIRM:
        number += 1
    firm = nature.draw_floor(number)
    return lambda start_ns: nature.plant(firm, np.random.default_rng(seed), start_ns)


def path_ratio(nature: str, seed: int, found: Try) -> float:
    """Return the path error of a mission with a calibration, over that without."""
    paths_m = []
    for response in (None, found.response):
        config = _with_response(configure_version("shipped", seed), response)
        paths_m.append(drive_config(config, nature, seed, found.gyro.falsify)[0].path_m)
    return paths_m[1] / paths_m[0]


def _with_response(config: Config, response: GyroResponse | None) -> Config:
    assert config.slip is not None
    return config.model_copy(update={"slip": config.slip.model_copy(update={"gyro_response": response})})


def main() -> int:
    """Print the tries and the ratio; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tries", type=int, default=12, help="on each of rigid, springy, and firm floors")
    parser.add_argument("--floors", type=int, default=60)
    parser.add_argument("--first", type=int, default=500)
    arguments = parser.parse_args()
    console, seeds = Console(soft_wrap=True), range(arguments.first, arguments.first + arguments.tries)
    grounds = {
        "rigid": [f"rigid {LAWS[seed % 3]}" for seed in seeds],
        "springy": [f"springy {LAWS[seed % 3]}" for seed in seeds],
        "firm floors": [NATURE_NAMES[seed % len(NATURE_NAMES)] for seed in seeds],
    }
    is_met = True
    with open_executor(None) as pool:
        written: list[Try] = []
        for kind, names in grounds.items():
            tries = _track(pool.map(calibrate, names, seeds), len(names), kind)
            for each in tries:
                console.print(str(each))
            good = [each for each in tries if not each.problem]
            wrong = [each for each in good if each.deviations > MOST_DEVIATIONS]
            console.print(f"{kind}: written {len(good)} of {len(tries)}, beyond 3 sd {len(wrong)}")
            is_met &= not wrong
            if kind == "rigid":
                written, is_met = good, is_met and len(good) >= FEWEST_WRITTEN * len(tries)
        floors = range(arguments.first, arguments.first + arguments.floors)
        natures = [NATURE_NAMES[seed % len(NATURE_NAMES)] for seed in floors]
        calibrations = [written[seed % len(written)] for seed in floors]
        ratios = _track(pool.map(path_ratio, natures, floors, calibrations), len(floors), "missions")
    logs = np.log(ratios)
    half = 1.96 * float(logs.std(ddof=1)) / math.sqrt(len(logs))
    low, mean, high = (math.exp(float(logs.mean()) + each) for each in (-half, 0.0, half))
    console.print(f"path with over without: geometric mean {mean:.2f}, 95 % from {low:.2f} to {high:.2f}")
    return int(not is_met or high > GREATEST_RATIO)


def _track(results: Iterable[T], count: int, title: str) -> list[T]:
    return list(track(results, title, total=count, console=Console(stderr=True)))


if __name__ == "__main__":
    raise SystemExit(main())
