"""The list of drives, and the things that cast shadows in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .shadows import Clouds, Leaves, Occluder, Passer, Rover, Still

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Drive:
    """One drive. Angles in degrees, lengths in metres, blur in pixels."""

    name: str
    look: str
    ground: str
    plan: str  # one letter per stretch, see motion.BANDS
    fps: float
    frames: int
    speed: float
    height: float
    focal: float
    lateral: float = 0.2
    yaw: tuple[float, ...] = (0.0,)  # rad/s over the drive
    drift: tuple[float, ...] = (0.0,)  # slip angle over the drive
    trace: bool = False
    sun: tuple[float, float] = (200.0, 50.0)  # azimuth from the first heading, elevation
    share: float = 0.75  # of the light that comes from the sun
    shadows: tuple[str, ...] = ()
    dirt: tuple[str, ...] = ()
    level: float = 0.3  # mean linear exposure
    change: str = ""  # of exposure: step, drift or auto
    blur: float = 0.0  # motion blur without slip
    shake: float = 0.0
    defocus: float = 0.0
    haze: float = 0.0
    contrast: float = 1.0
    wells: float = 1.0  # full well against the standard one; less means more noise

    def effects(self) -> list[str]:
        """Name everything that is done to this drive."""
        names = [f"shadow:{s}" for s in self.shadows] + [f"dirt:{d}" for d in self.dirt]
        for flag, name in (
            (self.trace, "trace"),
            (any(self.yaw), "curve"),
            (any(self.drift), "drift"),
            (self.level < 0.05, "dark"),
            (self.blur, f"motion_blur_{self.blur:g}px"),
            (self.shake, f"shake_{self.shake:g}px"),
            (self.defocus, f"defocus_{self.defocus:g}px"),
            (self.haze or self.contrast < 1, "low_contrast"),
            (self.change, f"exposure_{self.change}"),
            (self.wells < 1, "noise"),
            ("R" in self.plan, "slides_back"),
            ("b" in self.plan, "rolls_back"),
            ("S" in self.plan, "stands_wheels_turn"),
            ("0" in self.plan, "stands_wheels_still"),
        ):
            if flag:
                names.append(name)
        return names


DRIVES: tuple[Drive, ...] = (
    Drive("clean_00", "clean", "smooth_sand", "ABCD", 5, 90, 0.10, 0.75, 760, trace=True),
    Drive("clean_01", "clean", "rippled_sand", "BACDA", 8, 110, 0.09, 0.60, 640, yaw=(0.0, 0.12, 0.2, 0.05),
        sun=(150, 35)),
    Drive("clean_02", "clean", "pea_gravel", "CABD", 10, 110, 0.12, 0.50, 580, drift=(0, 8, 12, 4),
        share=0.3),
    Drive("clean_03", "clean", "stony_sand", "ADRB", 6, 90, 0.08, 0.85, 780, sun=(230, 42), trace=True),
    Drive("clean_04", "clean", "cracked_clay", "DCBAb", 10, 120, 0.07, 0.55, 600, drift=(-6, 0),
        sun=(170, 60)),
    Drive("clean_05", "clean", "crumbly_soil", "B0ACS", 5, 95, 0.06, 0.70, 700, share=0.55,
        yaw=(0.0, -0.1, -0.05)),
    Drive("shadow_00", "shadow", "smooth_sand", "ACBD", 5, 90, 0.09, 0.80, 770, sun=(10, 38),
        shadows=("own",)),
    Drive("shadow_01", "shadow", "rippled_sand", "BDAC", 8, 100, 0.08, 0.65, 660, yaw=(0.05, 0.18, 0.1),
        sun=(-25, 42), shadows=("own", "posts")),
    Drive("shadow_02", "shadow", "crumbly_soil", "CBDA", 6, 90, 0.10, 0.70, 700, sun=(140, 50),
        shadows=("leaves",)),
    Drive("shadow_03", "shadow", "pea_gravel", "DABC", 10, 100, 0.11, 0.50, 580, drift=(0, -10, -4),
        sun=(160, 55), shadows=("clouds", "posts")),
    Drive("shadow_04", "shadow", "smooth_sand", "ABDC", 5, 85, 0.07, 0.75, 740, sun=(30, 45),
        shadows=("own", "passers"), trace=True),
    Drive("shadow_05", "shadow", "stony_sand", "BCRDA", 8, 120, 0.12, 0.60, 640, drift=(3, 9, -3),
        sun=(-40, 35), shadows=("own", "leaves", "passers")),
    Drive("dirt_00", "dirt", "smooth_sand", "ACDB", 5, 85, 0.10, 0.80, 760, dirt=("specks",)),
    Drive("dirt_01", "dirt", "pea_gravel", "BADC", 12, 110, 0.13, 0.55, 600, sun=(190, 40), dirt=("smears",)),
    Drive("dirt_02", "dirt", "straw_litter", "CDAB", 8, 100, 0.09, 0.65, 680, yaw=(0.0, -0.15, -0.2),
        dirt=("specks", "smears")),
    Drive("dirt_03", "dirt", "rippled_sand", "DBCA", 6, 85, 0.08, 0.70, 700, sun=(20, 40), shadows=("own",),
        dirt=("specks", "smears"), trace=True),
    Drive("dark_00", "dark", "crumbly_soil", "ABCD", 5, 80, 0.09, 0.70, 700, level=0.010, share=0.15),
    Drive("dark_01", "dark", "smooth_sand", "CADB", 6, 85, 0.08, 0.60, 660, level=0.008, sun=(180, 25)),
    Drive("dark_02", "dark", "grey_dust", "BDAC", 8, 95, 0.11, 0.80, 760, level=0.006, yaw=(0.0, 0.1),
        sun=(215, 25), trace=True),
    Drive("blur_00", "blur", "pea_gravel", "ABCD", 6, 80, 0.13, 0.55, 640, blur=12),
    Drive("blur_01", "blur", "stony_sand", "BADC", 5, 65, 0.14, 0.45, 720, blur=22, sun=(150, 45)),
    Drive("blur_02", "blur", "rippled_sand", "ACBD", 5, 65, 0.15, 0.42, 830, blur=33, drift=(0, 6)),
    Drive("blur_03", "blur", "straw_litter", "CDBA", 6, 80, 0.10, 0.70, 700, defocus=3.5),
    Drive("blur_04", "blur", "cracked_clay", "DBAC", 5, 60, 0.08, 0.65, 680, shake=12, yaw=(0.0, 0.08)),
    Drive("contrast_00", "contrast", "smooth_sand", "ABDC", 5, 80, 0.09, 0.80, 770, share=0.1, haze=0.35,
        contrast=0.6),
    Drive("contrast_01", "contrast", "grey_dust", "CABD", 8, 90, 0.07, 0.60, 660, share=0.15, haze=0.4,
        contrast=0.7, drift=(0, 7)),
    Drive("contrast_02", "contrast", "rippled_sand", "BDCA", 10, 110, 0.11, 0.70, 700, share=0.2, haze=0.5,
        contrast=0.5, yaw=(-0.1, -0.2, 0.0), wells=0.5),
    Drive("exposure_00", "exposure", "stony_sand", "ADBC", 8, 95, 0.10, 0.65, 680, change="step",
        sun=(160, 40)),
    Drive("exposure_01", "exposure", "grey_dust", "BCAD", 6, 80, 0.08, 0.75, 740, change="drift",
        shadows=("clouds",), wells=0.25),
    Drive("exposure_02", "exposure", "straw_litter", "CBDA", 15, 120, 0.12, 0.55, 620, change="auto",
        sun=(15, 45), shadows=("own", "passers"), wells=0.4),
    Drive("standing_00", "standing", "crumbly_soil", "SS", 5, 70, 0.09, 0.70, 700, sun=(20, 40),
        shadows=("own", "leaves")),
    Drive("standing_01", "standing", "stony_sand", "00", 8, 70, 0.09, 0.60, 640, sun=(160, 45),
        shadows=("clouds", "passers")),
    Drive("standing_02", "standing", "smooth_sand", "0S0S", 5, 100, 0.10, 0.75, 740, sun=(-20, 42),
        shadows=("own", "mimic")),
    Drive("standing_03", "standing", "rippled_sand", "S0A", 6, 90, 0.08, 0.65, 680, sun=(150, 50),
        shadows=("clouds", "leaves"), dirt=("specks",)),
)  # fmt: skip


def sun_direction(drive: Drive) -> F64:
    """Return the unit vector towards the sun."""
    azimuth, elevation = np.radians(drive.sun)
    return np.array(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
    )


def make_occluders(
    rng: np.random.Generator, drive: Drive, sun: F64, box: tuple[float, float, float, float]
) -> list[Occluder]:
    """Place what casts shadows inside the box of ground that the drive sees."""
    low, high = np.array(box[:2]), np.array(box[2:])
    found: list[Occluder] = [Rover(sun)] if drive.share > 0.25 else []
    if "posts" in drive.shadows:
        bars = []
        for _ in range(int(rng.integers(5, 9))):
            mid, turn = rng.uniform(low, high), rng.uniform(0, np.pi)
            half = np.array([np.cos(turn), np.sin(turn)]) * rng.uniform(0.3, 1.2)
            side = np.array([-np.sin(turn), np.cos(turn)]) * rng.uniform(0.01, 0.06)
            bars.append(
                np.array([mid - half - side, mid + half - side, mid + half + side, mid - half + side])
            )
        found.append(Still(bars, 0.8))
    if "leaves" in drive.shadows:
        count = int(90 * np.prod(high - low))
        found.append(
            Leaves(
                rng.uniform(low, high, (count, 2)),
                rng.uniform(0.015, 0.06, count),
                rng.uniform(0, 6, count),
                rng.uniform(0, 2.5, count),
                rng.uniform(0.02, 0.05),
                rng.uniform(0.25, 0.6),
            )
        )
    if "passers" in drive.shadows:
        for _ in range(3):
            pace, turn = rng.uniform(0.15, 0.6), rng.uniform(0, 2 * np.pi)
            way = np.array([np.cos(turn), np.sin(turn)])
            span = float(np.hypot(*(high - low))) + 0.4
            aside = np.array([-way[1], way[0]]) * rng.uniform(-0.3, 0.3)
            found.append(
                Passer(
                    _blob(rng, 0.12, 0.3),
                    pace * way,
                    0.5 * (low + high) + aside - way * 0.5 * span,
                    span / pace,
                )
            )
    if "mimic" in drive.shadows:  # moves over the ground as the wheels would move it
        for i in range(6):
            start = np.array([high[0] - 0.1 + 0.35 * i, rng.uniform(low[1] + 0.2, high[1] - 0.2)])
            start[0] -= 0.8
            found.append(Passer(_blob(rng, 0.06, 0.2), np.array([-drive.speed, 0.0]), start, 100.0))
    if "clouds" in drive.shadows:
        pace, turn = rng.uniform(0.4, 2.0), rng.uniform(0, 2 * np.pi)
        found.append(
            Clouds(
                pace * np.array([np.cos(turn), np.sin(turn)]),
                rng.uniform(0.3, 1.2),
                rng.uniform(3.0, 6.0),
                rng.uniform(0.5, 0.75),
                rng.uniform(0, 6),
            )
        )
    return found


def _blob(rng: np.random.Generator, least: float, most: float) -> F64:
    """Return a crooked polygon about the origin."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(4, 9))))
    radii = rng.uniform(least, most, len(angles))
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], 1)
