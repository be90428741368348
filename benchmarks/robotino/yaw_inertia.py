"""Yaw inertia by motor currents and gyro, against the formula, on firm floors of `tests/nature/floors`.

    python -m benchmarks.robotino.yaw_inertia [--in-place] [--floors 6] [--first 600]

The shipped Robotino travels with its yaw excitation, or turns back and forth in place at the frequency of
`calibrate imu`, on an endless floor of the tile that resists least. In each second of it a sinusoid is
fitted to the yaw moment of the motors (torque of each wheel by current and speed, times arm over radius) and
to the gyro. The moment over the angular acceleration is the inertia, the drag its part in phase with the
rate. Printed are the relative errors against the plant's own inertia, of the median of a drive, for currents
that are taken to be as old as the positions and 20 ms older.
"""

import argparse
import cmath
import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.gates.floors import configure_version
from benchmarks.safety.missions import drive
from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.motion.settings import SmallTurnsMission
from controllers.slip.effort.motor_model import wheel_torque
from drivers.samples import RateSample, Sample, WheelSample
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor
from tests.nature.floors import NATURES, Nature
from tests.nature.floors.patchwork import Floor

NATURE_NAMES = ("bristle", "tread", "carpet")
DRIVE_S, FIRST_S, WINDOW_S = 25.0, 6.0, 1.0
LEAST_RATE_RAD_S = 0.08
CURRENT_AGES_S = (0.0, 0.02)
Array = NDArray[np.float64]


def firmest(nature: Nature, floor: Floor) -> Floor:
    """Return an endless floor of the tile with the least resistance."""
    resistance = floor.grid.constants[:, :, nature.resistance]
    row, column = divmod(int(np.argmin(resistance)), resistance.shape[1])
    return floor.uniform(row, column)


def errors_of(name: str, seed: int, *, is_in_place: bool) -> tuple[float, ...]:
    """Drive once; return the relative errors of the formula, and of the fit for each of `CURRENT_AGES_S`."""
    nature = next(nature for nature in NATURES if nature.name == name)
    floor = firmest(nature, nature.draw_floor(seed))
    config = configure_version("calibrated gyro", seed)
    assert config.slip is not None
    driven = config
    if is_in_place:
        turns = SmallTurnsMission(
            type="small_turns", frequencies_hz=(config.slip.excitation.frequency_hz,), each_s=DRIVE_S
        )
        driven = config.model_copy(update={"mission": turns, "slip": None})
    wheels: list[list[tuple[float, float, float]]] = [[], [], []]
    gyro: list[tuple[float, float]] = []

    def keep(_: float, sample: Sample) -> Sample:
        if isinstance(sample, WheelSample) and sample.position_rad is not None:
            wheels[sample.wheel].append((sample.t_ns / 1e9, sample.position_rad, sample.current_a or 0.0))
        if isinstance(sample, RateSample):
            gyro.append((sample.t_ns / 1e9, sample.rate_z_rad_s))
        return sample

    drive(
        driven,
        keep,
        limit_s=DRIVE_S,
        make_plant=lambda start_ns: nature.plant(floor, np.random.default_rng(seed), start_ns),
    )
    machine = floor.machine
    # The yaw inertia of the settings is that about the centre of the wheels.
    offset_m = math.hypot(machine.com_x_m, machine.com_y_m)
    true_kg_m2 = machine.yaw_inertia_kg_m2 + machine.mass_kg * offset_m**2
    assert isinstance(config.rover, OmniRoverSettings)
    outermost_m = config.rover.base_radius_m + config.rover.wheel_radius_m
    inertias = [config.slip.excitation.inertia_kg_m2(outermost_m)]
    moment = _moment_nm(config, [np.array(rows) for rows in wheels])
    inertias += [_inertia_kg_m2(config, moment, np.array(gyro), age_s) for age_s in CURRENT_AGES_S]
    return tuple(each / true_kg_m2 - 1.0 for each in inertias)


def _moment_nm(config: Config, wheels: Sequence[Array]) -> Array:
    """Return times in s and yaw moments in N m of all motors, (n, 2)."""
    assert config.slip is not None
    assert isinstance(config.rover, OmniRoverSettings)
    t_s, moment = wheels[0][:, 0], np.zeros(len(wheels[0]))
    for rows in wheels:
        speed = np.convolve(np.gradient(rows[:, 1], rows[:, 0]), np.full(3, 1.0 / 3.0), "same")
        # The board measures magnitudes: a motor that brakes for a moment is taken to drive.
        current = np.copysign(rows[:, 2], speed)
        values = zip(current, speed, np.gradient(speed, rows[:, 0]), strict=True)
        torque = [wheel_torque(config.slip.maps.motor, *value) for value in values]
        moment += np.interp(t_s, rows[:, 0], torque)
    return np.column_stack((t_s, config.rover.base_radius_m / config.rover.wheel_radius_m * moment))


def _inertia_kg_m2(config: Config, moment: Array, gyro: Array, current_age_s: float) -> float:
    """Return the median over the windows in which the body swings."""
    assert config.slip is not None
    turning = math.tau * config.slip.excitation.frequency_hz
    age_s = config.device_roles().wheel_age_s or 0.0
    inertias = []
    for start_s in np.arange(moment[0, 0] + FIRST_S, moment[-1, 0] - WINDOW_S, WINDOW_S):
        rate = _sinusoid(turning, gyro, start_s)
        if abs(rate) < LEAST_RATE_RAD_S:
            continue
        # Older readings lag: their angle is turned ahead.
        ahead = cmath.exp(1j * turning * (age_s + current_age_s))
        inertias.append((_sinusoid(turning, moment, start_s) * ahead / (1j * turning * rate)).real)
    return float(np.median(inertias)) if inertias else math.nan


def _sinusoid(turning: float, rows: Array, start_s: float) -> complex:
    t_s, values = rows[(rows[:, 0] >= start_s) & (rows[:, 0] < start_s + WINDOW_S)].T
    t_s = t_s - start_s
    columns = np.column_stack((np.cos(turning * t_s), np.sin(turning * t_s), np.ones(len(t_s)), t_s))
    coefficients, *_ = np.linalg.lstsq(columns, values, rcond=None)
    return complex(coefficients[0], -coefficients[1])


def main() -> None:
    """Print a line for the formula and for each age of the currents."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--in-place", action="store_true", help="turn back and forth without travel")
    parser.add_argument("--floors", type=int, default=6)
    parser.add_argument("--first", type=int, default=600, help="seed of the first floor")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    jobs = [(name, arguments.first + floor) for name in NATURE_NAMES for floor in range(arguments.floors)]
    with open_executor(arguments.cluster) as pool:
        results = pool.map(partial(errors_of, is_in_place=arguments.in_place), *zip(*jobs, strict=True))
        errors = np.array(list(track(results, "floors", total=len(jobs), console=Console(stderr=True))))
    ages = [f"fit, currents {1e3 * age_s:.0f} ms older" for age_s in CURRENT_AGES_S]
    for name, each in zip(("formula", *ages), errors.T, strict=True):
        known = each[np.isfinite(each)]
        rms, near = math.sqrt(float(np.mean(known**2))), int(np.sum(np.abs(known) <= 0.15))
        print(f"{name}: rms {rms:.2f}, bias {known.mean():+.2f}, within 15 % {near} of {len(each)}")


if __name__ == "__main__":
    main()
