"""Whether gains that are tuned on the twin of a rover are better on this rover than those of shipped values.

    python -m benchmarks.tuning.twin [--rovers 20] [--first 120] [--trials 16] [--train 3] [--unseen 12]
        [--out FILE]

Each rover is drawn by `tests.nature.drawn_rover`, which knows nothing of the program, and described by the
numbers of a drawing. It is driven six times, `diagnose --enter` enters what the drives show into its
configuration, and its gains are tuned twice with the same budget and seed: in the simulation that was
entered, and in that of the description with shipped values. Both are then driven on the rover itself on days
that decided nothing, with the entered [rover], [filter] and [ground], and judged by the cost that `tune`
minimises. The gain is how much less the gains of the twin cost. Results that are in the file are not made
again. Rovers up to 100 are for development.
"""

import argparse
import contextlib
import io
import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
import tomlkit

from drivers.clock import seconds, stopwatch_ns
from rover_hil.config import Config, load_config
from rover_hil.config.tune_settings import CaseSettings
from rover_hil.diagnose.command import diagnose_drives
from rover_hil.run.driving import run_virtual
from rover_hil.tune.objective import case_cost
from rover_hil.tune.parameters import check_parameters, start_values, with_values
from rover_hil.tune.simulated_mission import SimulatedMission, simulate_mission
from rover_hil.tune.study import MissionStudy
from sim_backends import build
from sim_backends.settings import SimulationSettings
from sim_backends.world.plant import Truth
from tests.nature.drawn_rover import DrawnRover, Motion, draw, of_the_day

EXAMPLE = Path("docs/examples/differential.toml")
RADIUS_M, TRACK_M = 0.06, 0.3
SUPPLY_V = 24.0
RATE_HZ = 25.0
SPEED_M_S = 0.25
PATH_M = [[0.6, 0.0], [0.9, 0.5]]
LONGEST_S = 60.0
ALONG = {"heading": "along_path", "speed_m_s": SPEED_M_S}
WHEELS = {"type": "can_wheels", "wheel_rate_hz": 50.0}
DRAWS = 10_000


class DrawnPlant:
    """The drawn rover in the place of the simulated one; what the gyro reads is its yaw rate."""

    wheel_count = 2

    def __init__(self, rover: DrawnRover, rng: np.random.Generator, start_ns: int) -> None:
        self._motion = Motion(rover, rng)
        self._start_ns = self._t_ns = start_ns

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Set the setpoints."""
        self._motion.set_speeds(seconds(self._t_ns - self._start_ns), speed_rad_s)

    def advance(self, t_ns: int) -> None:
        """Integrate to a time."""
        self._t_ns = max(t_ns, self._t_ns)
        self._motion.advance(seconds(self._t_ns - self._start_ns))

    def truth(self) -> Truth:
        """Return the state."""
        motion = self._motion
        return Truth(
            t_ns=self._t_ns,
            x_m=motion.x_m,
            y_m=motion.y_m,
            yaw_rad=motion.yaw_rad,
            roll_rad=0.0,
            pitch_rad=0.0,
            velocity_x_m_s=motion.ahead_m_s,
            velocity_y_m_s=0.0,
            yaw_rate_rad_s=motion.gyro_rad_s,
            wheel_position_rad=tuple(motion.angle_rad),
            wheel_speed_rad_s=tuple(motion.speed_rad_s),
            motor_current_a=(0.2, 0.2),
            slip=(0.0, 0.0),
            battery_v=SUPPLY_V,
            bumper_pressed=False,
        )


@contextlib.contextmanager
def on_rover(rover: DrawnRover, seed: int) -> Iterator[None]:
    """Let simulated devices be those of a drawn rover on one day."""
    rng = np.random.default_rng((seed, 7))
    today = of_the_day(rover, rng)

    def make(_: SimulationSettings, start_ns: int) -> DrawnPlant:
        return DrawnPlant(today, rng, start_ns)

    with patch.object(build, "_make_plant", make):
        yield


def described(folder: Path) -> Path:
    """Write the configuration of a rover as its user would; return its path."""
    document = tomlkit.parse(EXAMPLE.read_text("utf-8"))
    document["devices"]["wheels"]["mapping"] = str(EXAMPLE.parent.resolve() / "can" / "differential.toml")
    document["loop"]["rate_hz"] = RATE_HZ
    document["loop"]["time_limit_s"] = LONGEST_S
    document["safety"]["settle_s"] = 0.5
    document["simulation"]["devices"] = {"wheels": WHEELS}
    document["mission"] = {"type": "waypoints", "points": PATH_M, **ALONG}
    path = folder / "rover.toml"
    path.write_text(document.as_string(), "utf-8")
    return path


def missions() -> list[dict[str, object]]:
    """Return what is driven for the diagnosis."""

    def bend(side: float) -> list[list[float]]:
        angles = [math.tau * each / 24 for each in range(1, 25)]
        return [[0.6 * math.sin(each), side * 0.6 * (1.0 - math.cos(each))] for each in angles]

    straight = {"type": "waypoints", "points": [[2.0, 0.0]], **ALONG}
    square = {"type": "rectangle", "length_m": 0.7, "width_m": 0.7, **ALONG}
    bends = [{"type": "waypoints", "points": bend(side), **ALONG} for side in (1.0, -1.0)]
    return [straight, square, *bends, straight, square]


def record(config: Path, rover: DrawnRover, folder: Path, seed: int) -> list[Path]:
    """Drive the rover; return the logs."""
    logs = []
    for number, mission in enumerate(missions()):
        document = tomlkit.parse(config.read_text("utf-8"))
        document["mission"] = mission
        document["simulation"]["devices"] = {"wheels": WHEELS, "imu": ideal_gyro()}
        path = folder / "drive.toml"
        path.write_text(document.as_string(), "utf-8")
        logs.append(folder / f"drive{number}.mcap")
        with on_rover(rover, 1000 * seed + number):
            run_virtual(load_config(str(path)), logs[-1], LONGEST_S, None)
    return logs


def ideal_gyro() -> dict[str, object]:
    """Return the errors of a device that sends the reading of the drawn gyro."""
    zero = ("gyro_bias_deg_s", "gyro_walk_deg_s", "gyro_noise_deg_s")
    return {"type": "witmotion", **dict.fromkeys(zero, 0.0)}


def serial(config: Config, seeds: Sequence[int]) -> Iterator[SimulatedMission]:
    """Simulate missions one after the other."""
    for seed in seeds:
        yield simulate_mission(config, seed)


def with_tune(config: Config, seed: int, train: int) -> Config:
    """Return a configuration that tunes what the shipped Robotino tunes, to the same end."""
    shipped = load_config("robotino").tune
    assert shipped is not None
    cases = CaseSettings(train=train, held_out=1)
    return config.model_copy(update={"tune": shipped.model_copy(update={"cases": cases, "seed": seed})})


def tuned(config: Config, folder: Path, name: str, trials: int) -> dict[str, float]:
    """Return the gains with the least cost of a search in the simulation of a configuration."""
    settings = check_parameters(config)
    study = MissionStudy(folder / f"{name}.jsonl", name, config, settings)
    study.search(serial, trials, lambda: False, lambda: None)  # type: ignore[arg-type]
    best = study.candidates()
    return dict(best[0].values) if best else start_values(config, settings)


def driven(config: Config, rover: DrawnRover, values: dict[str, float], seeds: Sequence[int]) -> list[float]:
    """Return the costs of gains on the rover itself; infinite where the mission is rejected."""
    simulation = config.require_simulation()
    gyro = build.EMULATOR.validate_python(ideal_gyro())
    errors = {**simulation.devices, "imu": gyro}
    bare = simulation.model_copy(update={"devices": errors, "found": None})
    config = with_values(config, values).model_copy(update={"simulation": bare})
    assert config.tune is not None
    costs = []
    for seed in seeds:
        with on_rover(rover, seed):
            mission = simulate_mission(config, seed)
        costs.append(math.inf if mission.refused else case_cost(mission, config.tune.objective))
    return costs


def quantile_cost(config: Config, costs: Sequence[float]) -> float:
    """Return the quantile of the costs that `tune` takes; infinite where a mission is rejected, as there."""
    assert config.tune is not None
    if not np.isfinite(costs).all():
        return math.inf
    return float(np.quantile(costs, config.tune.objective.quantile))


def gain(twin: float, shipped: float) -> float:
    """Return how much less the twin costs; 0 where both are rejected."""
    if math.isinf(twin):
        return 0.0 if math.isinf(shipped) else -math.inf
    return 1.0 if math.isinf(shipped) else 1.0 - twin / shipped


def judge(number: int, trials: int, train: int, unseen: int) -> dict[str, object]:
    """Return the result of one rover."""
    started_ns = stopwatch_ns()
    rover = draw(np.random.default_rng(number), RADIUS_M, TRACK_M)
    with TemporaryDirectory() as place:
        folder = Path(place)
        path = described(folder)
        shipped = with_tune(load_config(str(path)), number, train)
        logs = record(path, rover, folder, number)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            code = diagnose_drives(logs, out=folder / "found", config_name=str(path), enter=True, quick=True)
        entered = with_tune(load_config(str(path)), number, train)
        found = entered.require_simulation().found
        diagnosed_ns = stopwatch_ns()
        values = {
            "twin": tuned(entered, folder, "twin", trials),
            "shipped": tuned(shipped, folder, "shipped", trials),
        }
        seeds = range(100_000 + 1000 * number, 100_000 + 1000 * number + unseen)
        tuned_ns = stopwatch_ns()
        costs = {name: driven(entered, rover, each, seeds) for name, each in values.items()}
    cost = {name: quantile_cost(entered, each) for name, each in costs.items()}
    return {
        "rover": number,
        "exit": code,
        "found": {} if found is None else {name: each.value for name, each in found.numbers.items()},
        "delay_s": rover.dead_time_s + rover.lag_s,
        "cost": {name: round(each, 3) for name, each in cost.items()},
        "gain": round(gain(cost["twin"], cost["shipped"]), 4),
        "values": values,
        "seconds": {
            "diagnosed": round(seconds(diagnosed_ns - started_ns)),
            "tuned": round(seconds(tuned_ns - diagnosed_ns)),
            "driven": round(seconds(stopwatch_ns() - tuned_ns)),
        },
    }


def median_interval(gains: Sequence[float], seed: int = 0) -> tuple[float, float, float]:
    """Return the median and its 95 % interval by the bootstrap over rovers."""
    rng = np.random.default_rng(seed)
    values = np.maximum(np.array(gains), -10.0)  # a median of infinite numbers is none
    drawn = np.median(values[rng.integers(len(values), size=(DRAWS, len(values)))], axis=1)
    low, high = np.quantile(drawn, (0.025, 0.975)).tolist()
    return float(np.median(values)), low, high


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rovers", type=int, default=20)
    parser.add_argument("--first", type=int, default=120)
    parser.add_argument("--trials", type=int, default=16)
    parser.add_argument("--train", type=int, default=3)
    parser.add_argument("--unseen", type=int, default=12)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    started_ns = stopwatch_ns()
    numbers = range(arguments.first, arguments.first + arguments.rovers)
    out: Path | None = arguments.out
    lines = out.read_text().splitlines() if out is not None and out.exists() else []
    results: list[dict[str, object]] = [json.loads(line) for line in lines]
    finished = [each["rover"] for each in results]
    for number in numbers:
        if number in finished:
            continue
        results.append(judge(number, arguments.trials, arguments.train, arguments.unseen))
        line = json.dumps(results[-1])
        print(line, flush=True)
        if out is not None:
            with out.open("a") as file:
                file.write(f"{line}\n")
    gains = [float(str(each["gain"])) for each in results]
    median, low, high = median_interval(gains)
    better = sum(each > 0.0 for each in gains)
    print(f"gain: median {median:.3f} (95 %: {low:.3f} to {high:.3f}), better on {better} of {len(gains)}")
    print(f"{seconds(stopwatch_ns() - started_ns) / 60.0:.1f} min")
    return 0


if __name__ == "__main__":
    sys.exit(main())
