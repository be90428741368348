"""Slip-compensated driving on the simulated El-Dorado: the loop from camera to steering, frame by frame.

    python -m benchmarks.four_wheels.field_crab [--seeds 10]

The rover of each seed of `field_tests` drives the sites of both tests along their x axis, on the same ground
by three drivers: nobody steers; all wheels are steered by the heading alone; all wheels are steered against
the slip angle of the trace, too (`crab_steering`). The two-segment slip law of this driver is from test 1 of
the same seed, driven without steering.

Prints as JSON for each test and driver, over the seeds: median and greatest distance from the line at the
end, median rms of it on the way, in m. Exit code 1 when steering against the slip angle does not halve both
medians of nobody steering. A seed takes about a minute on an idle machine.
"""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from benchmarks.four_wheels.crab_steering import CrabGains, CrabSteering
from benchmarks.four_wheels.field_drives import (
    FRAME_RATE_HZ,
    LONGEST_S,
    REST_S,
    ROCK_DEG,
    SIDEWAYS,
    SPEED_M_S,
    Floats,
    Rover,
    Site,
    compass_error_deg,
    draw_look,
    draw_rover,
    field_drive,
    make_plant,
    wheel_speed_rad_s,
)
from benchmarks.four_wheels.field_tests import FIRST_SEED, SITES, parameters_of, see
from controllers.ftrace.estimator import TraceEstimator
from controllers.ground_motion.rig import RigFile
from controllers.slip.scomp.parameters import ScompParameters
from drivers.clock import nanoseconds
from drivers.samples import Image
from sim_backends.plants.el_dorado.plant import ElDoradoPlant
from sim_backends.rear_scene.scene import Pose, RearScene, rotations
from sim_backends.world.plant import Truth
from sim_backends.world.sensor_errors import DirectionLag
from tests.rear_scene.draws import wander

PRESSES_PER_FRAME = 4
PRESS_S = 1.0 / FRAME_RATE_HZ / PRESSES_PER_FRAME
COMPASS_TIME_S = 15.0

Driver = Literal["no steering", "heading only", "crab"]
DRIVERS: tuple[Driver, ...] = ("no steering", "heading only", "crab")


class Eyes:
    """The camera on the rover, and the trace estimator behind it."""

    def __init__(self, rover: Rover, site: Site, rng: np.random.Generator) -> None:
        frames = math.ceil(LONGEST_S * FRAME_RATE_HZ)
        look = draw_look(site, rng, frames)
        self._terrain, self._rig, self._depth_m = site.terrain(), rover.rig, look.rut.depth_m
        self._scene = RearScene(rover.rig, look.ground, look.sun, look.rut, look.lens, rng)
        self._estimator = TraceEstimator(RigFile.model_validate(rover.rig.as_json()).geometry())
        steps = frames * PRESSES_PER_FRAME + 1
        rocking = [wander(steps, 0.35 / PRESS_S, rng) for _ in range(2)]
        self.rock_rad: Floats = np.radians(ROCK_DEG) * np.stack(rocking, axis=1)

    def pose(self, truth: Truth, press: int) -> Pose:
        """Return where the rover is, as the scene takes it."""
        cosine, sine = math.cos(truth.yaw_rad), math.sin(truth.yaw_rad)
        wheels = [(wheel.x_m, wheel.y_m) for wheel in self._rig.wheels]
        heights = [
            float(
                self._terrain.height_m(
                    np.array(truth.x_m + cosine * x - sine * y), np.array(truth.y_m + sine * x + cosine * y)
                )
            )
            for x, y in wheels
        ]
        angles = (np.array([angle]) for angle in (truth.yaw_rad, truth.pitch_rad, truth.roll_rad))
        roll, pitch = self.rock_rad[press].tolist()
        return Pose(
            position_m=np.array([truth.x_m, truth.y_m, np.mean(heights) - self._depth_m]),
            vehicle_to_world=rotations(*angles)[0],
            rock_rad=(roll, pitch),
            yaw_rad=truth.yaw_rad,
            wheel_angle_rad=truth.wheel_position_rad[2],
            velocity_m_s=(truth.velocity_x_m_s, truth.velocity_y_m_s),
            yaw_rate_rad_s=truth.yaw_rate_rad_s,
        )

    def press(self, truth: Truth, press: int) -> None:
        """Press the ruts up to where the rover is."""
        self._scene.drive(self.pose(truth, press))

    def see(self, truth: Truth, press: int, rates_rad_s: tuple[float, float, float]) -> float | None:
        """Return the direction in which the rear left wheel travels in the body; None without a trace."""
        image: Image = self._scene.render(self.pose(truth, press))
        rim_m_s = 0.092 * float(np.mean(truth.wheel_speed_rad_s))
        grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
        angle = self._estimator.step(
            nanoseconds(press * PRESS_S), grey, wheel_speed_m_s=rim_m_s, rates_rad_s=rates_rad_s
        )
        return angle.theta_rad if angle.detected else None


@dataclass
class Heading:
    """Gyro for the short, compass for the long; both zeroed while the rover rests."""

    rover: Rover
    rng: np.random.Generator
    heading_rad: float = 0.0
    bias_rad_s: float = 0.0
    compass_zero_rad: float = 0.0
    readings: int = 0

    def __post_init__(self) -> None:
        self._lag = DirectionLag(0.45, PRESS_S)
        self._true_bias_rad_s = math.radians(float(self.rng.normal(0, 0.15)))

    def step(self, truth: Truth) -> float:
        """Take readings, and return the yaw rate of the gyro."""
        noise_deg_s, noise_deg = 0.12 * self.rng.standard_normal(), 0.4 * self.rng.standard_normal()
        rate = truth.yaw_rate_rad_s + self._true_bias_rad_s + math.radians(float(noise_deg_s))
        lagged = self._lag.step(truth.yaw_rad)
        compass = lagged + math.radians(compass_error_deg(lagged, self.rover) + float(noise_deg))
        self.readings += 1
        if self.readings * PRESS_S < REST_S:
            self.bias_rad_s += (rate - self.bias_rad_s) / self.readings
            self.compass_zero_rad += (compass - self.compass_zero_rad) / self.readings
            return rate
        self.heading_rad += (rate - self.bias_rad_s) * PRESS_S
        gap = compass - self.compass_zero_rad - self.heading_rad
        self.heading_rad += PRESS_S / COMPASS_TIME_S * gap
        return rate


def crab_drive(rover: Rover, site: Site, seed: int, driver: Driver, parameters: ScompParameters) -> Floats:
    """Drive a site along its x axis; returns the way as rows x, y in m, one per frame, from its start.

    Args:
        rover: Of the seed.
        site: Before its own draws.
        seed: The same for all drivers: they meet the same ground.
        driver: Who steers.
        parameters: Their two-segment slip law gives the slip.
    """
    rng = np.random.default_rng([seed, 3, len(site.mounds)])
    site = site.drawn(rng)
    plant = make_plant(rover, site, rng)
    eyes, heading = Eyes(rover, site, rng), Heading(rover, rng)
    steering = CrabSteering(CrabGains())
    way: list[tuple[float, float]] = []
    before, press = plant.truth(), 0
    while before.x_m < site.way_m and press < len(eyes.rock_rad) - PRESSES_PER_FRAME:
        for _ in range(PRESSES_PER_FRAME):
            press += 1
            truth = _advance(plant, rover, press)
            rate = heading.step(truth)
            rates = (*_tilt_rates(eyes.rock_rad, before, truth, press), rate)
            before = truth
            if driver == "crab":
                eyes.press(truth, press)
        travel = eyes.see(truth, press, rates) if driver == "crab" else None
        rim_m_s = wheel_speed_rad_s(press * PRESS_S) * 0.092
        drift = 0.0 if travel is None else travel
        speed = rim_m_s * (1.0 - parameters.two_segment_slip.slip_at(abs(drift)))
        if travel is not None and speed > 0.0:
            travel += parameters.rover.rear_axle_m * (rate - heading.bias_rad_s) / speed  # eq 2
        if driver != "no steering" and rim_m_s >= SPEED_M_S:
            angle = steering.step(1.0 / FRAME_RATE_HZ, speed, heading.heading_rad, travel)
            plant.set_steering((angle,) * 4)
        way.append((truth.x_m, truth.y_m))
    return np.array(way)


def _advance(plant: ElDoradoPlant, rover: Rover, press: int) -> Truth:
    speeds = wheel_speed_rad_s(press * PRESS_S) * (1.0 + rover.wheel_scale)
    plant.set_wheel_speeds(speeds.tolist())
    plant.advance(nanoseconds(press * PRESS_S))
    return plant.truth()


def _tilt_rates(rock_rad: Floats, before: Truth, after: Truth, press: int) -> tuple[float, float]:
    """Return the rates about x and y of the rocking body over the last step."""
    rock = (rock_rad[press] - rock_rad[press - 1]).tolist()
    roll, pitch = after.roll_rad - before.roll_rad, after.pitch_rad - before.pitch_rad
    return (roll + rock[0]) / PRESS_S, (pitch + rock[1]) / PRESS_S


def distances(way: Floats) -> dict[str, float]:
    """Return how far the rover was from its line: at the end, and rms over equal steps along it."""
    steps = np.linspace(0.0, way[-1, 0], 200)
    beside = np.interp(steps, way[:, 0], way[:, 1])
    return {"final_m": abs(float(way[-1, 1])), "rms_m": float(np.sqrt(np.mean(beside**2)))}


def run_seed(seed: int) -> dict[str, dict[str, dict[str, float]]]:
    """Return the distances of a seed by test and driver."""
    rover = draw_rover(seed)
    recorded = field_drive(rover, SIDEWAYS, seed)
    parameters = parameters_of(recorded, see(recorded, "fused"))
    return {
        name: {who: distances(crab_drive(rover, site, seed, who, parameters)) for who in DRIVERS}
        for name, site in SITES.items()
    }


def summary(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return medians over the seeds, and the greatest final distance."""
    medians = {name: round(float(np.median([row[name] for row in rows])), 3) for name in rows[0]}
    return medians | {"greatest_final_m": round(max(row["final_m"] for row in rows), 3)}


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    arguments = parser.parse_args()
    results = []
    for seed in range(FIRST_SEED, FIRST_SEED + arguments.seeds):
        results.append(run_seed(seed))
        print(f"seed {seed}: {json.dumps(results[-1])}", file=sys.stderr)
    report = {
        name: {who: summary([result[name][who] for result in results]) for who in DRIVERS} for name in SITES
    }
    print(json.dumps({"seeds": arguments.seeds, **report}, indent=2))
    return 0 if all(_halves(rows["crab"], rows["no steering"]) for rows in report.values()) else 1


def _halves(row: dict[str, float], reference: dict[str, float]) -> bool:
    return all(row[name] <= 0.5 * reference[name] for name in ("final_m", "rms_m"))


if __name__ == "__main__":
    sys.exit(main())
