"""Effects of `rover-hil gap rover` hidden in the simulated six-wheel rover, and what is named.

    python -m benchmarks.gap.rover_of_wheels [--drives 6] [--duration 24] [--seed 0] [--only none]

For each truth the plant of docs/examples/six_wheels.toml, on the gray floor, drives random legs: straight and
arcs, forwards and backwards, by steering of its corners. Logs hold wheel angles, measured steering angles,
gyro and pose with noise; the configuration of the logs is the unchanged one. Plant and model share their
contact laws, so the table shows what can be distinguished, not whether the laws are right. The plant has no
inclined ground: for `side_slope` the weight along the slope is added here to each of its milliseconds.
Prints a table; exit code 1 where a hidden effect is not in the set, or another is named.
"""

import argparse
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from typer.testing import CliRunner

from benchmarks.gap.drive_logs import START_NS
from controllers.motion.kinematics import make_kinematics
from drivers.clock import SystemClock
from drivers.clock import seconds as to_seconds
from drivers.samples import RateSample, Sample, WheelSample
from drivers.units import STANDARD_GRAVITY_M_S2
from rover_hil.app.app import app
from rover_hil.config import Config, load_config
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.schema import TRUTH
from rover_hil.recording.writer import LogWriter
from sim_backends.plants.wheels.plant import WheelsPlant, make_rover
from sim_backends.plants.wheels.settings import WheelsPlantSettings

ROOT = Path(__file__).parents[2]
CONFIG = "docs/examples/six_wheels.toml"
FLOOR = "gray"
ROW_MS = 20
LEG_S, CHANGE_S, DURATION_S = 4.0, 0.5, 24
POSE_NOISE_M, POSE_NOISE_RAD, GYRO_NOISE_RAD_S = 0.0003, 0.0005, 0.002
HEADER = (
    "| truth | verdict | root mean square on locked runs, before and after | seconds, of the processors |\n"
    "|---|---|---|---|"
)


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """What is hidden in the truth; the name is that of the effect."""

    name: str
    drag: float = 0.0
    stiffness: float = 1.0
    offset_deg: float = 0.0
    slope_deg: float = 0.0
    downhill_deg: float = 0.0

    @property
    def size(self) -> str:
        """In words."""
        return {
            "side_slope": f"{self.slope_deg:g} deg, downhill to {self.downhill_deg:g} deg",
            "rolling_resistance": f"{self.drag:g} of the load",
            "contact_stiffness": f"ln {self.stiffness:g} = {math.log(self.stiffness):.2f}",
            "steering_offset": f"{self.offset_deg:g} deg, wheel 1",
        }.get(self.name, "")


TRUTHS = (
    Hidden(name="none"),
    Hidden(name="rolling_resistance", drag=0.06),
    Hidden(name="rolling_resistance", drag=0.15),
    Hidden(name="rolling_resistance", drag=0.3),
    Hidden(name="contact_stiffness", stiffness=0.5),
    Hidden(name="contact_stiffness", stiffness=0.2),
    Hidden(name="steering_offset", offset_deg=3.0),
    Hidden(name="side_slope", slope_deg=6.0, downhill_deg=-90.0),
)


class Sloped(WheelsPlant):
    """The simulated rover, with the weight along a slope.

    Args:
        settings: The true rover.
        rng: Source of the ground's roughness.
        hidden: The slope.
    """

    def __init__(self, settings: WheelsPlantSettings, rng: np.random.Generator, hidden: Hidden) -> None:
        super().__init__(settings, rng, START_NS)
        mass = make_rover(settings).mass
        self._to_twist = np.linalg.inv(mass)
        self._weight_n = float(mass[0, 0]) * STANDARD_GRAVITY_M_S2 * math.sin(math.radians(hidden.slope_deg))
        self._downhill_rad = math.radians(hidden.downhill_deg)

    def pull(self, step_s: float) -> None:
        """Add what the weight gives in a step."""
        downhill = self._downhill_rad - float(self._state.pose[2])
        force_n = self._weight_n * np.array([math.cos(downhill), math.sin(downhill), 0.0])
        self._state.twist[:] += step_s * self._to_twist @ force_n


def configuration() -> Config:
    """Return the example on the gray floor."""
    table = load_config(CONFIG).model_dump(by_alias=True)
    site = {
        **(table["simulation"]["plant"].get("site") or {}),
        "floor": FLOOR,
        "roughness": 0.0,
        "patches": [],
    }
    table["simulation"]["plant"]["site"] = site
    return Config.model_validate(table)


def true_settings(settings: WheelsPlantSettings, hidden: Hidden) -> WheelsPlantSettings:
    """Return the settings of the true rover."""
    surface = settings.site.surfaces[FLOOR]
    surface = surface.model_copy(
        update={
            "drag_along": surface.drag_along + hidden.drag,
            "stiffness": surface.stiffness * hidden.stiffness,
        }
    )
    site = settings.site.model_copy(update={"surfaces": {**settings.site.surfaces, FLOOR: surface}})
    first = settings.wheels[0]
    assert first.steering is not None
    steering = first.steering.model_copy(update={"offset_deg": hidden.offset_deg})
    wheels = (first.model_copy(update={"steering": steering}), *settings.wheels[1:])
    return settings.model_copy(update={"site": site, "wheels": wheels})


def write_drive(
    path: Path, config: Config, hidden: Hidden, rng: np.random.Generator, duration_s: int = DURATION_S
) -> None:
    """Drive random legs with the true rover and write what its sensors show."""
    settings = config.require_simulation().plant
    assert isinstance(settings, WheelsPlantSettings)
    truth = true_settings(settings, hidden).model_copy(
        update={"start_yaw_deg": float(rng.uniform(-180.0, 180.0))}
    )
    plant, kinematics = Sloped(truth, rng, hidden), make_kinematics(config.rover)
    path.parent.mkdir(parents=True)
    record = config.model_dump_json(by_alias=True).encode()
    steering_rad = (0.0,) * plant.wheel_count
    leg, wanted, moving = -1, (0.0, 0.0), np.zeros(2)
    with LogWriter(path, START_NS, record, collect_data_files(config), "virtual") as log:
        for step in range(1000 * duration_s):
            t_ns = START_NS + step * 1_000_000
            if int(step / 1e3 / LEG_S) != leg:
                leg = int(step / 1e3 / LEG_S)
                ahead = float(rng.choice((-1.0, 1.0)) * rng.uniform(0.1, 0.25))
                wanted = (
                    ahead,
                    ahead * float(rng.choice((0.0, 0.0, 1.0, -1.0))) * float(rng.uniform(0.5, 1.2)),
                )
            if step % ROW_MS == 0:
                moving += ROW_MS / 1e3 / CHANGE_S * (np.array(wanted) - moving)
                set_points = kinematics.set_points(float(moving[0]), 0.0, float(moving[1]), steering_rad)
                plant.set_wheel_speeds(set_points.speed_rad_s)
                plant.set_steering(set_points.steering_rad)
            plant.advance(t_ns)
            state = plant.truth()
            plant.pull(1e-3)
            if step % ROW_MS == 0:
                steering_rad = state.steering_rad or steering_rad
                x_m, y_m = (
                    one + POSE_NOISE_M * float(rng.standard_normal()) for one in (state.x_m, state.y_m)
                )
                yaw_rad = state.yaw_rad + POSE_NOISE_RAD * float(rng.standard_normal())
                log.write_json(TRUTH, t_ns, {"t_ns": t_ns, "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad})
                rate = state.yaw_rate_rad_s + GYRO_NOISE_RAD_S * float(rng.standard_normal())
                samples: list[Sample] = [
                    WheelSample(
                        device="wheels",
                        t_ns=t_ns,
                        wheel=wheel,
                        position_rad=angle,
                        steering_rad=steering_rad[wheel],
                    )
                    for wheel, angle in enumerate(state.wheel_position_rad)
                ]
                log.samples(t_ns, [*samples, RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=rate)])


def verdict_on(hidden: Hidden, drives: int, seed: int, duration_s: int) -> dict[str, Any]:
    """Return the verdict on drives of one truth."""
    config, rng = configuration(), np.random.default_rng(seed)
    text = (ROOT / CONFIG).read_text("utf-8")
    site = f'site = {{ floor = "{FLOOR}", roughness = 0.0 }}'
    text = text.replace('site = "floor_table"', site)
    return verdict_on_written(text, lambda path: write_drive(path, config, hidden, rng, duration_s), drives)


def verdict_on_written(config_text: str, write: Callable[[Path], None], drives: int) -> dict[str, Any]:
    """Return the verdict of `rover-hil gap rover` on drives that `write` writes as logs."""
    with tempfile.TemporaryDirectory() as folder:
        runs, file = Path(folder) / "runs", Path(folder) / "rover.toml"
        for number in range(drives):
            write(runs / str(number) / "run.mcap")
        file.write_text(config_text, "utf-8")
        return verdict_of(str(file), [runs])


def verdict_of(source: str, drives: Sequence[Path]) -> dict[str, Any]:
    """Return the verdict of `rover-hil gap rover`.

    `command_s` are the seconds of the whole command, reading and writing too, and those of the processors.

    Args:
        source: Configuration of the rover, or file of columns.
        drives: Logs, folders of logs, or tables.
    """
    with tempfile.TemporaryDirectory() as folder:
        clock, begin_processors_s = SystemClock(), time.process_time()
        begin_ns = clock.now_ns()
        found = CliRunner().invoke(app, ["gap", "rover", source, *map(str, drives), "--out", f"{folder}/gap"])
        took_s = (to_seconds(clock.now_ns() - begin_ns), time.process_time() - begin_processors_s)
        file = Path(folder) / "gap" / "verdict.json"
        if not file.exists():
            raise SystemExit(f"gap failed: {found.output}{found.exception}")
        verdict: dict[str, Any] = json.loads(file.read_text("utf-8"))
    return {**verdict, "command_s": took_s}


def main() -> int:
    """Print a row for each truth; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--drives", type=int, default=6)
    parser.add_argument("--duration", type=int, default=DURATION_S, help="of a drive, s")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=sorted({one.name for one in TRUTHS}))
    arguments = parser.parse_args()
    os.chdir(ROOT)
    is_right = True
    print(HEADER, flush=True)
    for hidden in TRUTHS:
        if arguments.only in (None, hidden.name):
            verdict = verdict_on(hidden, arguments.drives, arguments.seed, arguments.duration)
            names = [one["name"] for one in verdict["effects"]]
            is_right &= names == ([] if hidden.name == "none" else [hidden.name])
            print(row(f"{hidden.name} {hidden.size}", verdict), flush=True)
    return 0 if is_right else 1


def row(truth: str, verdict: dict[str, Any]) -> str:
    """Return a row of the table."""
    named = "; ".join(
        f"{one['name']} "
        + ", ".join(f"{name} {number['value']:.3g}" for name, number in one["parameters"].items())
        for one in verdict["effects"]
    )
    gap = verdict["gap"].items()
    errors = "; ".join(f"{name} {one['before']:.3g}, {one['after']:.3g}" for name, one in gap)
    seconds = ", ".join(f"{one:.1f}" for one in verdict["command_s"])
    return f"| {truth} | {verdict['verdict']} {named} | {errors} | {seconds} |"


if __name__ == "__main__":
    sys.exit(main())
