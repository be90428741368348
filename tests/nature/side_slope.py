"""A rover on a side slope as nature makes it: wheels, soil and path, apart from every model of them.

Stresses are summed over a grid of patches of the wheels' rims (midpoint rule), all runs at once; the steady
state is found by damped Newton steps, and the rover's path is marched. Radian, metre, newton inside.
"""

import copy
import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.nature.wedge import GRAVITY, wedge_thrust

Array = NDArray[np.float64]
CONDITIONS = ((10.0, 23.8), (15.0, 23.8), (20.0, 23.8), (20.0, 33.8))
ROLLS = (0.0, 5.0, 10.0, 15.0, 20.0)
RIM_SPEED_MM_S = 20.0
SAMPLE_S = 0.5
WAY_MM = 1000.0
STRIPS, PATCHES = 8, 20
START_M = 0.1
MOST_STEPS, CLOSE, CLOSE_ENOUGH = 25, 1e-7, 1e-5
PERTURBED = {
    "friction": 0.35,
    "shear": 0.0006,
    "bearing": 2.5,
    "exponent": 0.008,
    "height": 0.002,
    "radius": 1e-4,
    "lateral": 0.0015,
    "heading": 0.07,
    "camera": 0.07,
}
"""Standard deviation of how far nature is from the tables."""


@dataclass(frozen=True, kw_only=True)
class Nature:
    """What is true; numbers up to `radius` are those of the tables, the others 0 where nothing is hidden.

    Attributes:
        flow: Downhill speed of the soil over rim speed, per deg of slope above `flow_onset` (deg), which is
            `flow_softness` deg wide; grows with mass to `flow_load`; backward speed is `flow_back` of it.
        drift: Turn of the rover uphill, deg/m, on 20 deg with 23.8 kg; grows with mass to `drift_load`.
        digging: Depth per slip ratio, at slip 0.1; grows with slip to `digging_power`.
        tether, side_pull: Out of every catalogue: cables that pull backward and to the downhill side, N.
        trampled: Out of every catalogue: soil of the uphill ruts bears more, parts.
        edges: Out of every catalogue: wheels on their edges sink deeper, mm per (deg of roll)^2 / 100.
        heat: Out of every catalogue: torque constant lost with torque squared, parts per (N m)^2.
    """

    friction: float = 38.0
    shear: float = 0.0283
    bearing: float = 122.73
    exponent: float = 1.703
    height: float = 0.187
    lateral: float = 0.0
    radius: float = 0.097
    flow: float = 0.0
    flow_onset: float = 8.0
    flow_softness: float = 0.7
    flow_load: float = 1.0
    flow_back: float = 0.4
    drift: float = 0.0
    drift_load: float = 1.5
    heading: float = 0.0
    camera: float = 0.0
    grousers: float = 0.0
    digging: float = 0.0
    digging_power: float = 1.0
    tether: float = 0.0
    side_pull: float = 0.0
    trampled: float = 0.0
    edges: float = 0.0
    heat: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """How it is measured; `kind` is white, ar, heavy or quantised."""

    replicates: int = 3
    noise: float = 1.0
    kind: str = "white"
    setting_deg: float = 0.25
    conditions: Sequence[tuple[float, float]] = CONDITIONS
    rolls: Sequence[float] = ROLLS


@dataclass(frozen=True)
class Sites:
    """Where runs are made; arrays of one length, degrees and kg."""

    slope: Array
    roll: Array
    mass: Array


@dataclass(frozen=True)
class Travel:
    """Steady travel: body speeds over the rim speed, sinkages (m) and torques (N m) as runs x (up, down)."""

    ahead: Array
    aside: Array
    sinkage: Array
    torque: Array


def some_nature(rng: np.random.Generator, **hidden: float) -> Nature:
    """Draw base numbers as well as tables know them, and add what is hidden."""
    drawn = {}
    for name, spread in PERTURBED.items():
        drawn[name] = getattr(Nature(), name) + spread * float(np.clip(rng.standard_normal(), -2.0, 2.0))
    for name, change in hidden.items():
        drawn[name] = drawn.get(name, getattr(Nature(), name)) + change
    return Nature(**drawn)


def travel(nature: Nature, sites: Sites) -> Travel:
    """Return how rovers travel steadily: where they would run ahead of their wheels, with no slip."""
    wheels = _Wheels(nature, sites)
    state = wheels.balance(wheels.guess(), held=np.zeros(sites.slope.size, dtype=bool))
    # No balance with slip, or one with negative slip: the rover would run ahead of its wheels.
    free = (wheels.slips(state)[0] < 0.0) | (wheels.unbalanced(state) > CLOSE_ENOUGH)
    if free.any():
        state = wheels.balance(np.where(free[:, None], wheels.guess(), state), free)
    slip, aside = wheels.slips(state)
    forces = wheels.forces(slip, aside, state[:, 2:])
    scale = (nature.radius + nature.grousers) / nature.radius
    depth = state[:, 2:] + 1e-5 * nature.edges * sites.roll[:, None] ** 2
    return Travel((1.0 - slip) * scale, aside * scale, depth, forces[:, :, 3])


class _Wheels:
    """Forces on the uphill and downhill wheels of many runs; a state is (x, y, two sinkages).

    With rho^2 = x^2 + y^2 the slip ratio is rho x and the sideways speed rho y.
    """

    def __init__(self, nature: Nature, sites: Sites) -> None:
        self.nature = nature
        self.slope, self.roll = np.radians(sites.slope), np.radians(sites.roll)
        self.weight = sites.mass * GRAVITY
        turn = math.radians(nature.heading)
        steep, flat = np.sin(self.slope) * math.cos(turn), np.cos(self.slope)
        lever = nature.height * steep / flat
        share = np.stack([0.275 + nature.lateral - lever, 0.275 - nature.lateral + lever], axis=1) / 1.1
        load = self.weight[:, None] * share
        leaning = steep * np.sin(self.roll) + flat * np.cos(self.roll)
        self.load = load * leaning[:, None]
        self.aside = self.weight * (steep * np.cos(self.roll) - flat * np.sin(self.roll))
        self.aside = self.aside + nature.side_pull
        self.ahead = self.weight * np.sin(self.slope) * math.sin(turn) + nature.tether
        self.walls = self._walls(np.arctan(np.tan(self.slope) * math.cos(turn)))
        self.strip = (np.arange(STRIPS) + 0.5) / STRIPS * 0.1 - 0.05
        self.cell = (np.arange(PATCHES) + 0.5) / PATCHES

    def guess(self) -> Array:
        """Return a state to begin with."""
        pull = self.aside / self.weight
        state = np.empty((pull.size, 4))
        slip, aside = 0.02 + 0.4 * np.abs(pull), -np.sign(pull) * 1.2 * np.abs(pull) ** 1.5
        root = np.hypot(slip, aside) ** 0.5
        state[:, 0], state[:, 1] = slip / root, aside / root
        state[:, 2:] = 0.022 * (self.load / 56.0) ** 0.45
        return state

    def slips(self, state: Array) -> tuple[Array, Array]:
        """Return slip ratio and sideways speed over the speed of shearing."""
        size = np.hypot(state[:, 0], state[:, 1])
        return size * state[:, 0], size * state[:, 1]

    def balance(self, state: Array, held: NDArray[np.bool_]) -> Array:
        """Return balanced states; where `held`, without slip."""
        state = state.copy()
        state[held, 0] = 0.0
        rows, part = np.arange(len(state)), self
        for _ in range(MOST_STEPS):
            missing = part._missing(state[rows], held[rows])
            is_open = np.abs(missing).max(axis=1) >= CLOSE
            if not is_open.any():
                break
            rows, missing = rows[is_open], missing[is_open]
            part = self._only(rows)
            slopes = np.empty((rows.size, 4, 4))
            for column in range(4):
                step = 1e-6 if column < 2 else 1e-8
                moved = state[rows]
                moved[:, column] += step
                slopes[:, :, column] = (part._missing(moved, held[rows]) - missing) / step
            change = -np.linalg.solve(slopes, missing[:, :, None])[:, :, 0]
            change[:, :2] = np.clip(change[:, :2], -0.08, 0.08)
            change[:, 2:] = np.clip(change[:, 2:], -0.004, 0.004)
            state[rows] = part._shorten(state[rows], np.asarray(change, np.float64), held[rows], missing)
        return state

    def _only(self, rows: NDArray[np.intp]) -> "_Wheels":
        """Return the wheels of some of the runs."""
        part = copy.copy(self)
        for name in ("slope", "roll", "weight", "load", "aside", "ahead", "walls"):
            setattr(part, name, getattr(self, name)[rows])
        return part

    def unbalanced(self, state: Array) -> Array:
        """Return the greatest missing force of each run, in parts of its weight."""
        free = np.zeros(len(state), dtype=bool)
        return np.asarray(np.abs(self._missing(state, free)).max(axis=1))

    def _shorten(self, state: Array, change: Array, held: NDArray[np.bool_], missing: Array) -> Array:
        size = np.abs(missing).max(axis=1)
        share = np.ones(len(state))
        for _ in range(5):
            trial = state + share[:, None] * change
            worse = np.abs(self._missing(trial, held)).max(axis=1) > 1.5 * size + 1e-9
            if not worse.any():
                break
            share = np.where(worse, 0.4 * share, share)
        return state + share[:, None] * change

    def _missing(self, state: Array, held: NDArray[np.bool_]) -> Array:
        slip, aside = self.slips(state)
        forces = self.forces(slip, aside, state[:, 2:])
        total = 2.0 * forces.sum(axis=1)
        missing: Array = np.empty((len(state), 4))
        missing[:, 0] = np.where(held, state[:, 0], (total[:, 0] - self.ahead) / self.weight)
        missing[:, 1] = (total[:, 1] - self.aside) / self.weight
        missing[:, 2:] = forces[:, :, 2] / self.load - 1.0
        return missing

    def forces(self, slip: Array, aside: Array, sinkage: Array) -> Array:
        """Return force ahead, force to the left, force up and torque: runs x wheels x 4."""
        nature = self.nature
        radius, shearing = nature.radius, nature.radius + nature.grousers
        dug = nature.digging * 0.1 * (np.maximum(slip, 0.0) / 0.1) ** nature.digging_power
        bearing = sinkage - dug[:, None]
        lean = np.tan(self.roll)[:, None, None]
        depth = np.maximum(bearing[:, :, None] + self.strip * lean, 1e-7)[:, :, :, None]
        s, t = slip[:, None, None, None], aside[:, None, None, None]
        enter = np.arccos(1.0 - depth / radius)
        rebound = 0.82 + np.maximum(s, 0.0) * (-1.95 + 2.1 * np.maximum(s, 0.0))
        leave = -np.arccos(1.0 - np.maximum(rebound, 0.0) * depth / radius)
        peak = (0.4 + 0.15 * np.maximum(s, 0.0)) * enter
        modulus = self._modulus(bearing, lean[:, :, 0], enter, leave)
        total = np.zeros((slip.size, 2, 4))
        for low, high in ((leave, peak), (peak, enter)):
            angle = low + (high - low) * self.cell
            width = (high - low) / PATCHES * radius * 0.1 / STRIPS
            like = angle if low is peak else enter - (angle - leave) / (peak - leave) * (enter - peak)
            pressure = modulus * np.maximum(radius * (np.cos(like) - np.cos(enter)), 0.0) ** nature.exponent
            swept = enter - angle
            way = shearing * np.hypot(swept - (1.0 - s) * (np.sin(enter) - np.sin(angle)), t * swept)
            shear = pressure * math.tan(math.radians(nature.friction)) * -np.expm1(-way / nature.shear)
            fast = np.hypot(1.0 - (1.0 - s) * np.cos(angle), t) + 1e-15
            along, across = shear * (1.0 - (1.0 - s) * np.cos(angle)) / fast, -shear * t / fast
            parts = (
                along * np.cos(angle) - pressure * np.sin(angle),
                across,
                along * np.sin(angle) + pressure * np.cos(angle),
                along * shearing,
            )
            for place, part in enumerate(parts):
                total[:, :, place] += (part * width).sum(axis=(2, 3))
        total[:, :, 1] += self._wall_force(slip, aside, bearing)
        return total

    def _modulus(self, sinkage: Array, lean: Array, enter: Array, leave: Array) -> Array:
        length = (self.nature.radius * (np.sin(enter) - np.sin(leave))).max(axis=(2, 3))
        tangent = np.abs(lean)
        wide = np.where(tangent > 1e-9, sinkage / np.maximum(tangent, 1e-9) + 0.05, 0.1)
        least = np.minimum(length, np.minimum(wide, 0.1))
        value = 1490.0 * GRAVITY * self.nature.bearing * least ** (1.0 - self.nature.exponent)
        value = value * np.array([1.0 + self.nature.trampled, 1.0])
        return np.asarray(value[:, :, None, None])

    def _wall_force(self, slip: Array, aside: Array, sinkage: Array) -> Array:
        """Return what the soil beside the wheels does: it resists the wall that goes ahead sideways."""
        lean = np.tan(self.roll)[:, None]
        sine = aside / np.hypot(1.0 - slip, aside)
        result = np.zeros(sinkage.shape)
        for side, pushed, followed in ((-1.0, 0, 1), (1.0, 2, 3)):
            goes = aside * side > 0.0
            ahead = self._wall_area(sinkage + 0.05 * side * lean) * self.walls[:, pushed, None]
            behind = self._wall_area(sinkage - 0.05 * side * lean) * self.walls[:, followed, None]
            result += np.where(goes[:, None], -(ahead - behind) * sine[:, None], 0.0)
        return result

    def _wall_area(self, depth: Array) -> Array:
        """Return the integral of h^2 (r - h cos) over the wall in the soil."""
        radius = self.nature.radius
        enter = np.arccos(1.0 - np.maximum(depth, 1e-9) / radius)[:, :, None]
        angle = enter * (np.arange(40) + 0.5) / 40.0
        h = radius * (np.cos(angle) - np.cos(enter))
        return np.asarray((h**2 * (radius - h * np.cos(angle)) * enter / 20.0).sum(axis=2))

    def _walls(self, cross: Array) -> Array:
        """Return thrusts over h^2: downhill wall pushed, uphill wall following, then the other way round."""
        surface = np.radians(np.linspace(0.5, 89.5, 3561))
        rows = []
        for camber, slope in zip(self.roll, cross, strict=True):
            down, up = (camber - slope, -slope), (slope - camber, slope)
            rows.append(
                [
                    wedge_thrust(surface, *down, self.nature.friction, pushed=True),
                    wedge_thrust(surface, *up, self.nature.friction, pushed=False),
                    wedge_thrust(surface, *up, self.nature.friction, pushed=True),
                    wedge_thrust(surface, *down, self.nature.friction, pushed=False),
                ]
            )
        return np.array(rows)


def measure(
    nature: Nature, experiment: Experiment, rng: np.random.Generator
) -> tuple[list[dict[str, str]], list[dict[str, str]]]:
    """Return the rows of summary.csv and of paths.csv."""
    labels = [
        (number, slope, mass, roll, replicate)
        for number, (slope, mass) in enumerate(experiment.conditions, start=1)
        for roll in experiment.rolls
        for replicate in range(1, experiment.replicates + 1)
    ]
    wobble = experiment.setting_deg * rng.standard_normal((3, len(labels)))
    slope, mass, roll = (np.array([label[place] for label in labels]) for place in (1, 2, 3))
    found = travel(nature, Sites(slope + 0.5 * wobble[0], roll + wobble[1], mass))
    summary: list[dict[str, str]] = []
    paths: list[dict[str, str]] = []
    for index, (number, alpha, kg, psi, replicate) in enumerate(labels):
        name = f"c{number}_p{psi:g}_r{replicate}"
        rim = RIM_SPEED_MM_S * (1.0 + 0.003 * float(rng.standard_normal()))
        offset = 0.4 * experiment.setting_deg * float(rng.standard_normal())
        path = _path(nature, found, index, (alpha, kg), rim, offset)
        path[:, 1:] += experiment.noise * _scatter(experiment.kind, path[:, 1:].shape, 2.4, rng)
        if experiment.kind == "quantised":
            path[:, 1:] = np.round(path[:, 1:] / 4.0) * 4.0
        late = path[path[:, 1] > 0.3 * path[:, 1].max()]
        vx, vy = (float(np.polyfit(late[:, 0], late[:, column], 1)[0]) for column in (1, 2))
        row = {"run": name, "condition": str(number), "slope_deg": f"{alpha:g}", "mass_kg": f"{kg:g}"}
        row |= {"roll_deg": f"{psi:g}", "rep": str(replicate), "romega_mm_s": f"{rim:.3f}"}
        slip = 1.0 - vx / rim + 0.004 * experiment.noise * _one(experiment.kind, rng)
        angle = math.degrees(math.atan2(vy, vx)) + 0.1 * experiment.noise * _one(experiment.kind, rng)
        row |= {"slip": f"{slip:.5g}", "slip_angle_deg": f"{angle:.5g}"}
        for place, side in enumerate(("up", "down")):
            depth = 1000.0 * found.sinkage[index, place] + experiment.noise * _one(experiment.kind, rng)
            depth = round(depth) if experiment.kind == "quantised" else depth
            torque = float(found.torque[index, place])
            torque *= 1.0 - nature.heat * torque**2 + 0.04 * experiment.noise * _one(experiment.kind, rng)
            row |= {f"sinkage_{side}_mm": f"{depth:.5g}", f"torque_{side}_Nm": f"{torque:.5g}"}
        summary.append(row)
        paths += [
            {"run": name, "t_s": f"{t:.1f}", "x_mm": f"{x:.1f}", "y_mm": f"{y:.1f}"} for t, x, y in path
        ]
    return summary, paths


def _path(
    nature: Nature, found: Travel, index: int, site: tuple[float, float], rim: float, offset_deg: float
) -> Array:
    """Return t, x, y of a body that is marched in steps of a tenth of a sample."""
    slope, mass = site
    soft = nature.flow_softness
    above = soft * math.log1p(math.exp(min((slope - nature.flow_onset) / soft, 500.0)))
    flow = nature.flow * above * (mass / 23.8) ** nature.flow_load
    steep = math.tan(math.radians(slope)) / 0.364
    rate = math.radians(nature.drift) * steep * (mass / 23.8) ** nature.drift_load
    ahead, aside = float(found.ahead[index]), float(found.aside[index])
    scale = rim * nature.radius / 0.097
    x = y = time = 0.0
    points = [(0.0, 0.0, 0.0)]
    while x < WAY_MM and time < 200.0:
        for _ in range(10):
            built = 1.0 - math.exp(-x / 1000.0 / START_M)
            turn = math.radians(nature.heading + offset_deg) + rate * x / 1000.0
            v, w = 1.0 - (1.0 - ahead) * built, aside * built
            x += 0.1 * SAMPLE_S * scale * (v * math.cos(turn) - w * math.sin(turn) - nature.flow_back * flow)
            y += 0.1 * SAMPLE_S * scale * (v * math.sin(turn) + w * math.cos(turn) - flow)
        time += SAMPLE_S
        points.append((time, x, y))
    path = np.array(points)
    turned = math.radians(nature.camera)
    rotation = np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])
    path[:, 1:] = path[:, 1:] @ rotation
    return path


def _one(kind: str, rng: np.random.Generator) -> float:
    return float(rng.standard_t(3) / math.sqrt(3.0) if kind == "heavy" else rng.standard_normal())


def _scatter(kind: str, shape: tuple[int, ...], size: float, rng: np.random.Generator) -> Array:
    white = rng.standard_normal(shape)
    if kind == "heavy":
        white = rng.standard_t(3, shape) / math.sqrt(3.0)
    if kind == "ar":
        for row in range(1, len(white)):
            white[row] = 0.95 * white[row - 1] + math.sqrt(1.0 - 0.95**2) * white[row]
    return np.asarray(size * white)


def write(folder: Path, nature: Nature, experiment: Experiment, rng: np.random.Generator) -> None:
    """Write summary.csv and paths.csv of one experiment."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, rows in zip(("summary.csv", "paths.csv"), measure(nature, experiment, rng), strict=True):
        with (folder / name).open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, fieldnames=list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
