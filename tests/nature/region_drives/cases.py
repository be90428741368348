"""Sets of drives: what is stated about the ground, what the ground is, and which sensors there are."""

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.nature.region_drives.grounds import Drag, Floor, Ground, Later, Shares, draw_patches, draw_smooth
from tests.nature.region_drives.motion import Gyro
from tests.nature.region_drives.plans import SHAPES
from tests.nature.region_drives.rovers import DIFFERENTIAL, ROVERS, Rover

Array = NDArray[np.float64]

UNKNOWN_SD, UNKNOWN_SIDEWAYS_SD = 0.3, 0.1
FIRM_SD, FIRM_SIDEWAYS_SD = 0.01, 0.005
LEARNED_SD, MOST_LEARNED = 0.03, 0.4
PATCH_M = 10.0
RADIUS_SD = 0.005
SINGLE = [(lost, sideways) for sideways in (0.0, 0.1) for lost in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)]
GYRO_FACTORS = (0.5, 1.0, 2.0, 4.0)
WALKS_RAD_SQRT_S = (0.0002, 0.0005, 0.001, 0.002)
READING_STEPS_RAD_S = (0.0, math.radians(0.01))


@dataclass(frozen=True, kw_only=True)
class Positions:
    """Positions from outside: at 2 Hz, white noise, in a frame that is turned and shifted at random."""

    noise_m: float
    yaw_noise_rad: float = 0.0
    """Zero: without yaw."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One drive before it is driven.

    Attributes:
        setting: `[ground]` of the configuration.
        about: The ground in words and numbers, for the answer.
        contradicts: Sensor that can contradict the setting; "" where the setting is true.
        begin_m: Distance by the wheels from which on the setting is wrong.
    """

    name: str
    rover: Rover
    shape: str
    length_m: float
    ground: Ground
    gyro: Gyro
    setting: dict[str, Any]
    about: dict[str, Any]
    contradicts: str = ""
    begin_m: float = math.inf
    positions: Positions | None = None
    rng: np.random.Generator = field(default_factory=np.random.default_rng)


def draw_gyro(rng: np.random.Generator) -> Gyro:
    """Return a gyro whose data sheet is true."""
    return Gyro(
        walk_rad_sqrt_s=float(rng.choice(WALKS_RAD_SQRT_S)), step_rad_s=float(rng.choice(READING_STEPS_RAD_S))
    )


def draw_field(
    rng: np.random.Generator, number: int, lost_sd: float, sideways_sd: float, mean: float = 0.0
) -> tuple[Ground, dict[str, Any]]:
    """Return a smooth field, squares and cells between lines in turn."""
    kind = ("smooth", "squares", "cells")[number % 3]
    if kind == "smooth":
        ground: Ground = draw_smooth(rng, lost_sd, sideways_sd, mean=mean, size_m=PATCH_M)
    else:
        are_squares = kind == "squares"
        ground = draw_patches(rng, lost_sd, sideways_sd, mean=mean, size_m=PATCH_M, are_squares=are_squares)
    return ground, {"ground": kind, "mean": mean, "lost_sd": lost_sd, "sideways_sd": sideways_sd}


def _drive(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return rover, shape, length and gyro of a drive."""
    return {
        "rover": ROVERS[number % 3],
        "shape": SHAPES[number // 3 % 3],
        "length_m": float(rng.uniform(10.5, 30.0)),
        "gyro": draw_gyro(rng),
        "rng": rng,
    }


def unknown(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return a drive on a ground of the prior of `unknown`."""
    ground, about = draw_field(rng, number // 3 + number // 9, UNKNOWN_SD, UNKNOWN_SIDEWAYS_SD)
    return _drive(number, rng) | {"ground": ground, "about": about, "setting": {"slip": "unknown"}}


def single(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return a drive on one ground, stated to be unknown."""
    lost, sideways = SINGLE[number // 5 % len(SINGLE)]
    about = {"ground": "single", "lost": lost, "sideways": sideways}
    drive = _drive(number, rng)
    return drive | {"ground": Shares(lost, sideways), "about": about, "setting": {"slip": "unknown"}}


def firm(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return a drive on a ground of the prior of `firm`."""
    ground, about = draw_field(rng, number // 3 + number // 9, FIRM_SD, FIRM_SIDEWAYS_SD)
    return _drive(number, rng) | {"ground": ground, "about": about, "setting": {"slip": "firm"}}


def _on_floor(
    number: int,
    rng: np.random.Generator,
    name: str,
    resistance: tuple[float, float],
    stiffness: tuple[float, float],
    pile: float,
) -> dict[str, Any]:
    drive = _drive(number, rng)
    direction = rng.uniform(0.0, math.tau)
    floor = Floor(
        resistance=float(rng.uniform(*resistance)),
        stiffness=float(rng.uniform(*stiffness)),
        radius_errors=RADIUS_SD * rng.standard_normal(len(drive["rover"].angles)),
        pile=(pile * math.cos(direction), pile * math.sin(direction)),
    )
    about = {
        "ground": name,
        "resistance": floor.resistance,
        "stiffness": floor.stiffness,
        "pile": pile,
        "radius_errors": floor.radius_errors.tolist(),
    }
    return drive | {"ground": floor, "about": about, "setting": {"slip": "firm"}}


def hard_floor(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return a drive on concrete or tiles: 0.1 to 0.25 % slip, radii wrong by 0.5 %."""
    return _on_floor(number, rng, "hard floor", (0.015, 0.03), (12.0, 20.0), 0.0)


def carpet(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return a drive on short carpet: 0.3 to 1 % slip, 0.2 to 0.4 % drift along the pile, radii as before."""
    return _on_floor(number, rng, "carpet", (0.03, 0.06), (6.0, 10.0), 0.025)


def learned(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return a drive on a ground whose mean is stated in the configuration."""
    mean = float(rng.uniform(0.0, MOST_LEARNED))
    ground, about = draw_field(rng, number // 3 + number // 9, LEARNED_SD, LEARNED_SD, mean)
    setting = {
        "slip": "learned",
        "slip_mean": mean,
        "slip_sd": LEARNED_SD,
        "cross_slip_sd": LEARNED_SD,
        "slip_distance_m": PATCH_M,
        "source": "stated by the test",
    }
    return _drive(number, rng) | {"ground": ground, "about": about, "setting": setting}


def contradicted(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return a drive declared `firm` on which slip begins, and one sensor that can show it.

    0 to 9: positions with 2 cm; 10 to 14: positions with yaw; 15 to 19: positions with 10 cm; 20 to 29: the
    gyro against wheels of two sides that lose different shares. There are no drives with measured ground
    motion: `import table` takes no such columns.
    """
    drive = firm(number, rng)
    lost, begin_m = float(rng.uniform(0.1, 0.5)), float(rng.uniform(3.0, 6.0))
    about = {"lost": lost, "begin_m": begin_m}
    if number < 20:
        sideways = float(rng.uniform(-0.05, 0.05))
        after: Ground = Drag(lost, sideways)
        about["sideways"] = sideways
        drive["positions"] = Positions(
            noise_m=0.10 if number >= 15 else 0.02, yaw_noise_rad=0.01 if 10 <= number < 15 else 0.0
        )
        drive["contradicts"] = "positions " + (
            "2 cm" if number < 10 else "2 cm and yaw" if number < 15 else "10 cm"
        )
    else:
        shares = lost * np.array((1.0, rng.uniform(0.1, 0.6)))[:: int(rng.choice((-1, 1)))]
        after = Shares(shares)
        about["lost_of_sides"] = shares.tolist()
        drive |= {"rover": DIFFERENTIAL, "contradicts": "gyro"}
    drive["length_m"] = float(rng.uniform(16.0, 30.0))
    return drive | {
        "ground": Later(drive["ground"], after, begin_m),
        "begin_m": begin_m,
        "about": drive["about"] | about,
    }


def gyro_factor(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return a firm drive with a gyro of 0.5, 1, 2 or 4 times the stated noise, 20 each; or a dead band."""
    drive = firm(number, rng)
    if number < 80:
        factor = GYRO_FACTORS[number // 20]
        drive["gyro"] = Gyro(
            walk_rad_sqrt_s=drive["gyro"].walk_rad_sqrt_s, step_rad_s=drive["gyro"].step_rad_s, factor=factor
        )
        return drive | {"about": drive["about"] | {"gyro": f"noise {factor:g}"}}
    # Bias and noise are smaller than the dead band, as in sensors that have one: at standstill it reads zero.
    drive["gyro"] = Gyro(walk_rad_sqrt_s=0.0002, bias_sd_rad_s=0.0012, has_dead_band=True)
    return drive | {"about": drive["about"] | {"gyro": "dead band"}}


SETS: dict[str, tuple[int, Callable[[int, np.random.Generator], dict[str, Any]]]] = {
    "unknown": (60, unknown),
    "single": (60, single),
    "firm": (60, firm),
    "hard_floor": (30, hard_floor),
    "carpet": (30, carpet),
    "learned": (60, learned),
    "contradicted": (30, contradicted),
    "gyro": (100, gyro_factor),
}


def draw(name: str, number: int, seed: int) -> Case:
    """Return a drive of a set; one seed gives the same drive."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode()), number])
    return Case(name=f"{name}-{number:03}", **SETS[name][1](number, rng))
