"""Draws one drive of a scene type: everything that is random, from one seed."""

import zlib
from dataclasses import dataclass

import numpy as np

from tests.nature.ground_drives.camera import Rig, Sensor, draw_rig
from tests.nature.ground_drives.ground import KINDS, Ground, Terrain, wet_patches
from tests.nature.ground_drives.light import Box, Foliage, Passing, ShadowPlane, Sun
from tests.nature.ground_drives.motion import Motion, MotionPlan, Sensors, drive, smooth_noise
from tests.nature.ground_drives.noise import Points
from tests.nature.ground_drives.rut import Pass, Strength, Tread, print_pass, weathered
from tests.nature.ground_drives.scenes import NO_PRINT, SCENES, Range, Recipe

CELL_M = 0.0016
LARGEST_GRID = 9_000_000
"""Cells of the largest grid; a longer drive gets larger cells."""


def generator(scene: str, seed: int, part: str) -> np.random.Generator:
    """Return the generator of one part of a drive; parts do not share numbers."""
    return np.random.default_rng((zlib.crc32(scene.encode()), seed, zlib.crc32(part.encode())))


def between(rng: np.random.Generator, limits: Range) -> float:
    """Return a uniform number between the limits."""
    return float(rng.uniform(*limits))


def whole(rng: np.random.Generator, limits: Range) -> int:
    """Return a whole number between the limits, both included."""
    return int(rng.integers(int(limits[0]), int(limits[1]) + 1))


def sign(rng: np.random.Generator) -> float:
    """Return +1 or -1."""
    return 1.0 if rng.uniform() < 0.5 else -1.0


@dataclass(frozen=True)
class Softness:
    """Where the ground takes a print: all over (`level` 1), nowhere (0), or between two places along x, m."""

    level: float
    begin_m: float = -1e9
    end_m: float = 1e9
    edge_m: float = 0.04

    def at(self, x: Points) -> Points:
        """Return the softness at positions along x, 0 to 1."""
        rise = np.clip((x - self.begin_m) / self.edge_m + 0.5, 0.0, 1.0)
        fall = np.clip((self.end_m - x) / self.edge_m + 0.5, 0.0, 1.0)
        return np.asarray(self.level * rise * fall, np.float64)


@dataclass(frozen=True)
class World:
    """Everything of one drive but its pictures.

    `times_s` are those of the frames; `cloud` is the share of the sun's light that clouds let through every
    10 ms of `motion`; `compass_rad` the compass' slow disturbance at the same times.
    """

    rig: Rig
    motion: Motion
    times_s: Points
    ground: Ground
    terrain: Terrain
    softness: Softness
    sun: Sun
    shadows: ShadowPlane
    body: Box
    cloud: Points
    sensor: Sensor
    sensors: Sensors
    compass_rad: Points


def draw_world(scene: str, seed: int, frames: int) -> World:
    """Return the drive of a scene type and a seed.

    Raises:
        KeyError: there is no scene type of that name.
    """
    recipe = SCENES[scene]
    rng = generator(scene, seed, "motion")
    speed = rng.uniform(0.06, 0.11)
    rig = draw_rig(generator(scene, seed, "rig"), round(float(speed), 3))
    times = _frame_times(generator(scene, seed, "dropped"), recipe, rig, frames)
    terrain = _draw_terrain(generator(scene, seed, "terrain"), recipe, speed * float(times[-1]))
    before_m = between(rng, recipe.before_m) if rng.uniform() < 0.8 else recipe.before_m[0]
    shake = between(rng, recipe.shake)
    plan = MotionPlan(
        speed_mps=speed,
        before_s=before_m / speed,
        duration_s=float(times[-1]),
        side_slip_rad=np.radians(sign(rng) * between(rng, recipe.side_slip_deg)),
        side_slip_rms_rad=np.radians(rng.uniform(0.3, 3.0)),
        yaw_rate_rad_s=np.radians(sign(rng) * between(rng, recipe.yaw_rate_dps)),
        yaw_rate_rms_rad_s=np.radians(rng.uniform(0.05, 0.5)),
        slip=rng.uniform(0.02, 0.35),
        slip_rms=rng.uniform(0.005, 0.04),
        tilt_rms_rad=np.radians(0.12 * shake),
        shake_rms_rad=np.radians(0.03 * shake),
    )
    motion = drive(rng, plan, terrain, np.asarray(list(rig.wheels().values())))
    softness = _draw_softness(rng, recipe, motion, rig)
    ground = _draw_ground(scene, seed, recipe, rig, motion, times, softness)
    light = generator(scene, seed, "light")
    body = _body(light, rig)
    sun, parts = _draw_sun(light, recipe, rig, body)
    return World(
        rig,
        motion,
        times,
        ground,
        terrain,
        softness,
        sun,
        _draw_shadows(generator(scene, seed, "shadows"), recipe, rig, motion, times, parts),
        body,
        _draw_cloud(generator(scene, seed, "cloud"), recipe, len(motion.time_s)),
        _draw_sensor(generator(scene, seed, "sensor"), recipe),
        _draw_sensors(generator(scene, seed, "sensors")),
        _draw_compass(generator(scene, seed, "compass"), len(motion.time_s)),
    )


def _frame_times(rng: np.random.Generator, recipe: Recipe, rig: Rig, frames: int) -> Points:
    """Return the times of the frames; a lost frame leaves a gap in time, not in the numbers."""
    gaps = 1 + (rng.uniform(size=frames) < recipe.dropped) * rng.integers(1, 3, frames)
    return np.asarray((np.cumsum(gaps) - gaps[0]) / rig.frames_per_s, np.float64)


def _draw_terrain(rng: np.random.Generator, recipe: Recipe, length_m: float) -> Terrain:
    low, high = recipe.mound_m
    if high <= 0.0:
        return Terrain(np.zeros((0, 4)))
    count = int(2.0 * (length_m + 3.0))
    x, y = rng.uniform(-2.0, length_m + 1.0, count), rng.uniform(-1.0, 1.2, count)
    return Terrain(
        np.column_stack(
            (x, y, rng.uniform(0.15, 0.4, count), rng.uniform(0.4, 1.0, count) * rng.uniform(low, high))
        )
    )


def _draw_softness(rng: np.random.Generator, recipe: Recipe, motion: Motion, rig: Rig) -> Softness:
    if recipe.prints == (NO_PRINT,):
        return Softness(0.0)
    if not recipe.appears:
        return Softness(1.0)
    x = motion.contact(rig.contact)[motion.time_s >= 0.0][:, 0]
    begin, end = rng.uniform(0.15, 0.35), rng.uniform(0.6, 0.8)
    begin_m, end_m = (float(x[0] + part * (x[-1] - x[0])) for part in (begin, end))
    return Softness(1.0, begin_m, end_m, rng.uniform(0.02, 0.1))


def _draw_ground(
    scene: str, seed: int, recipe: Recipe, rig: Rig, motion: Motion, times: Points, softness: Softness
) -> Ground:
    corners = rig.corners_on_ground()
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for time_s in times:
        heading = motion.at(motion.heading_rad, time_s)
        cos, sin = np.cos(heading), np.sin(heading)
        seen = corners @ np.asarray(((cos, sin), (-sin, cos)))
        seen += (motion.at(motion.x, time_s), motion.at(motion.y, time_s))
        low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
    margin = 0.15 if recipe.mound_m[1] > 0 else 0.08
    low, high = low - margin, high + margin
    cell = max(CELL_M, float(np.sqrt(np.prod(high - low) / LARGEST_GRID)))
    columns, rows = (int(np.ceil(v / cell)) for v in high - low)
    ground = Ground(
        cell,
        (float(low[0]), float(low[1])),
        np.zeros((rows, columns), np.float32),
        np.zeros((rows, columns, 3), np.float32),
    )
    rng = generator(scene, seed, "ground")
    KINDS[recipe.grounds[int(rng.integers(len(recipe.grounds)))]](rng, ground)
    wet = generator(scene, seed, "wet")
    patches = whole(wet, recipe.wet)
    if patches and wet.uniform() < 0.5:
        wet_patches(wet, ground, patches, recipe.wet_streaks)
        patches = 0
    _old_traces(generator(scene, seed, "old"), recipe, rig, motion, ground)
    if patches:
        wet_patches(wet, ground, patches, recipe.wet_streaks)
    if softness.level > 0.0:
        _own_trace(generator(scene, seed, "prints"), recipe, rig, motion, ground, softness)
    return ground


def draw_strength(rng: np.random.Generator, name: str) -> Strength:
    """Return how the ground takes prints: "strong", "medium", "weak", or "relief" (no change of tone)."""
    depth_m, tone = {
        "strong": ((0.008, 0.02), (0.08, 0.4)),
        "medium": ((0.004, 0.01), (0.03, 0.25)),
        "weak": ((0.0015, 0.004), (0.02, 0.1)),
        "relief": ((0.003, 0.01), (0.0, 0.0)),
    }[name]
    depth = between(rng, depth_m)
    change = between(rng, tone) * (-1.0 if rng.uniform() < 0.7 else 1.0)
    return Strength(
        depth_m=depth,
        berm_m=depth * rng.uniform(0.2, 1.0),
        grouser_m=min(depth * rng.uniform(0.2, 0.6), 0.006),
        tone=change,
        berm_tone=change * rng.uniform(-0.4, 0.9),
        smooth=rng.uniform(0.5, 0.95),
        lumps_m=min(0.3 * depth, 0.0035) * rng.uniform(0.3, 1.0),
    )


def _own_trace(
    rng: np.random.Generator, recipe: Recipe, rig: Rig, motion: Motion, ground: Ground, softness: Softness
) -> None:
    """Print all four wheels, the front ones first: the rear ones cover what they cross."""
    strength = draw_strength(rng, recipe.prints[int(rng.integers(len(recipe.prints)))])
    tread = Tread(rig.wheel_width_m, 2 * np.pi * rig.wheel_radius_m / rig.lugs)
    for name in ("front_left", "front_right", "rear_left", "rear_right"):
        point = rig.wheels()[name]
        soft = softness.at(motion.contact(point)[:, 0])
        until = float(motion.time_s[-1])
        print_pass(rng, ground, motion.wheel_pass(point, soft, until), tread, strength)


def _old_traces(rng: np.random.Generator, recipe: Recipe, rig: Rig, motion: Motion, ground: Ground) -> None:
    """Print traces of earlier drives of this rover and of other vehicles, more or less weathered."""
    own = Tread(rig.wheel_width_m, 2 * np.pi * rig.wheel_radius_m / rig.lugs)
    others_only = recipe.prints == (NO_PRINT,)  # hard ground: the rover did not print earlier either
    for _ in range(whole(rng, recipe.old)):
        along = rng.uniform() < recipe.along
        turn = rng.normal(0.0, 0.12) if along else rng.uniform(0.3, np.pi - 0.3)
        middle = rng.choice(len(motion.time_s))
        side = rig.half_track_m + (rng.normal(0.0, 0.2) if along else rng.normal(0.0, 0.3))
        centre = np.asarray((motion.x[middle] - 0.7, motion.y[middle] + side))
        if rng.uniform() < 0.5 and not others_only:
            tread, tracks = own, [-2 * rig.half_track_m, 0.0]
        else:
            width = float(
                rng.choice((rng.uniform(0.03, 0.06), rng.uniform(0.07, 0.13), rng.uniform(0.14, 0.2)))
            )
            tread = Tread(width, rng.uniform(0.012, 0.05), 0.08, rng.uniform(-0.6, 0.6), rng.uniform() < 0.5)
            tracks = [0.0]
        before = ground.height.copy()
        strength = draw_strength(rng, ("strong", "medium", "medium", "weak", "relief")[int(rng.integers(5))])
        bend = rng.normal(0.0, 0.15)
        rim = rng.uniform(1.0, 1.2)
        for offset in tracks:
            print_pass(rng, ground, _old_pass(centre, turn, bend, offset, rim), tread, strength)
        weathered(rng, ground, before, rng.uniform(0.2 if others_only else 0.0, 0.75))


def _old_pass(centre: Points, turn: float, bend_per_m: float, offset_m: float, rim_per_m: float) -> Pass:
    """Return a pass along an arc through a point, both ways, at an offset to the left."""
    way = np.arange(-6.0, 6.0, 0.002)
    direction = turn + np.clip(bend_per_m * way, -0.6, 0.6)
    points = np.column_stack((np.cumsum(np.cos(direction)), np.cumsum(np.sin(direction)))) * 0.002
    points += centre - points[len(way) // 2]
    points += offset_m * np.column_stack((-np.sin(direction), np.cos(direction)))
    return Pass(points, direction, direction, rim_per_m * way + 10.0, np.ones(len(way)))


def _body(rng: np.random.Generator, rig: Rig) -> Box:
    half = (
        rig.half_length_m + rng.uniform(-0.08, 0.08),
        rig.half_track_m + rng.uniform(-0.08, 0.1),
        rng.uniform(0.06, 0.14),
    )
    return Box((rng.uniform(-0.05, 0.05), 0.0, half[2] + rng.uniform(0.1, 0.22)), half)


def _draw_parts(rng: np.random.Generator, rig: Rig, body: Box) -> tuple[Box, ...]:
    """Return the parts that cast shadows: body, wheels, panel, masts, beams, boom of the camera."""
    parts = [body]
    radius, width = rig.wheel_radius_m, rig.wheel_width_m
    for x, y in rig.wheels().values():
        parts.append(Box((x, y, radius), (0.72 * radius, 0.5 * width, 0.98 * radius)))
        parts.append(Box((x, y, radius), (0.98 * radius, 0.5 * width, 0.5 * radius)))
    top = body.centre[2] + body.half[2]
    boom = 0.5 * (rig.position[0] - body.centre[0])
    half_width = rng.uniform(0.015, 0.04)
    parts.append(
        Box((body.centre[0] + boom, rig.position[1], rig.position[2] + 0.03), (abs(boom), half_width, 0.02))
    )
    post = 0.5 * (rig.position[2] - top)
    parts.append(Box((body.centre[0], rig.position[1], top + post), (0.02, half_width, post)))
    if rng.uniform() < 0.6:
        parts.append(
            Box(
                (rng.uniform(-0.2, 0.2), rng.uniform(-0.1, 0.1), top + rng.uniform(0.03, 0.3)),
                (rng.uniform(0.15, 0.45), rng.uniform(0.15, 0.4), 0.01),
            )
        )
    for _ in range(int(rng.integers(1, 5))):  # masts, antennas, instruments
        tall = rng.uniform(0.1, 0.6)
        half_x, half_y = rng.uniform(0.008, 0.07, 2)
        parts.append(
            Box(
                (rng.uniform(-0.4, 0.4), rng.uniform(-0.25, 0.3), top + tall),
                (half_x, half_y, tall),
                rng.uniform(0, np.pi),
            )
        )
    parts += [  # beams in any direction
        Box(
            (rng.uniform(-0.5, 0.2), rng.uniform(-0.2, 0.35), top + rng.uniform(0.0, 0.5)),
            (rng.uniform(0.2, 0.6), rng.uniform(0.008, 0.06), 0.015),
            rng.uniform(0, np.pi),
        )
        for _ in range(int(rng.integers(0, 3)))
    ]
    return tuple(parts)


def _draw_sun(rng: np.random.Generator, recipe: Recipe, rig: Rig, body: Box) -> tuple[Sun, tuple[Box, ...]]:
    """Return sun and parts of the rover such that its shadow covers the asked share of the view."""
    corners = rig.corners_on_ground()
    low, high = corners.min(axis=0), corners.max(axis=0)
    overcast = rng.uniform() < recipe.overcast
    for _ in range(200):
        elevation, azimuth = np.radians(between(rng, recipe.sun_elevation_deg)), rng.uniform(-np.pi, np.pi)
        warm = float(np.clip(1.0 - np.degrees(elevation) / 40.0, 0.0, 1.0))
        strength = rng.uniform(0.0, 0.12) if overcast else rng.uniform(0.7, 1.1)
        haze = rng.uniform(0.6, 0.9) if overcast else rng.uniform(0.12, 0.3) * (0.5 + 0.5 * np.sin(elevation))
        sky_tint = rng.uniform(0.0, 0.05) if overcast else rng.uniform(0.05, 0.25)
        sun = Sun(
            float(elevation),
            float(azimuth),
            strength * np.asarray((0.92 - 0.35 * warm, 0.98 - 0.15 * warm, 1.04)),
            haze * np.asarray((1.0 + sky_tint, 1.0, 1.0 - sky_tint)),
            rng.uniform(0.1, 0.6),
            rng.uniform(-np.pi, np.pi),
        )
        parts = _draw_parts(rng, rig, body)
        if recipe.rover_shadow is None:
            break
        plane = ShadowPlane(parts=parts)
        light = plane.transmission(sun, (0.0, 0.0, 0.0), np.eye(3), 0.0)
        left, back = (int((v - edge) / plane.cell_m) for v, edge in zip(low, plane.left_back, strict=True))
        right, front = (int((v - edge) / plane.cell_m) for v, edge in zip(high, plane.left_back, strict=True))
        if (
            recipe.rover_shadow[0]
            <= 1.0 - float(light[back:front, left:right].mean())
            <= recipe.rover_shadow[1]
        ):
            break
    return sun, parts


def _draw_shadows(
    rng: np.random.Generator, recipe: Recipe, rig: Rig, motion: Motion, times: Points, parts: tuple[Box, ...]
) -> ShadowPlane:
    duration = float(times[-1])
    passing = []
    count = int(rng.poisson(between(rng, recipe.passing) * duration / 10.0))
    if recipe.passing[0] >= 1.0:
        count = max(count, 2)
    for _ in range(count):
        time_s = rng.uniform(0.0, duration)
        speed = rng.uniform(0.03, 0.3) if rng.uniform() < 0.5 else rng.uniform(0.3, 2.0)
        course = rng.uniform(-np.pi, np.pi)
        velocity = speed * np.asarray((np.cos(course), np.sin(course)))
        if rng.uniform() < 0.35:  # walks or drives along with the rover
            velocity += (motion.at(motion.speed_mps, time_s), 0.0)
        passing.append(_thing(rng, rig, motion, time_s, velocity, rng.uniform(3.0, 40.0)))
    passing += [
        _thing(rng, rig, motion, rng.uniform(0.0, duration), np.zeros(2), 1e9)
        for _ in range(whole(rng, recipe.standing))
    ]
    foliage = _draw_foliage(rng, recipe, motion) if rng.uniform() < recipe.foliage else ()
    return ShadowPlane(parts=parts, passing=tuple(passing), foliage=foliage)


def _thing(
    rng: np.random.Generator, rig: Rig, motion: Motion, time_s: float, velocity: Points, life_s: float
) -> Passing:
    """Return a pole, a beam or a blob whose shadow is in view at a time."""
    if rng.uniform() < 0.6:
        long, wide = rng.uniform(0.4, 4.0), rng.uniform(0.015, 0.18)
        narrow = wide * rng.uniform(0.6, 1.0)
        outline = np.asarray(((-long, -wide), (long, -narrow), (long, narrow), (-long, wide)))
    else:
        angle = np.linspace(0, 2 * np.pi, 14, endpoint=False)
        outline = (
            rng.uniform(0.05, 0.5)
            * (1.0 + 0.25 * rng.standard_normal((14, 1)))
            * np.column_stack((np.cos(angle), np.sin(angle)))
        )
        outline *= (1.0, rng.uniform(0.3, 1.0))
    turn = rng.uniform(-np.pi, np.pi)
    cos, sin = np.cos(turn), np.sin(turn)
    outline = outline @ np.asarray(((cos, sin), (-sin, cos)))
    start = np.asarray(
        (
            motion.at(motion.x, time_s) - rig.half_length_m - 0.4,
            motion.at(motion.y, time_s) + rig.half_track_m,
        )
    )
    return Passing(
        outline,
        start + rng.normal(0.0, 0.15, 2),
        velocity,
        time_s,
        life_s,
        rng.uniform(0.3, 4.0),
        rng.uniform(0.85, 1.0),
    )


def _draw_foliage(rng: np.random.Generator, recipe: Recipe, motion: Motion) -> tuple[Foliage, ...]:
    """Return one or two layers of leaves on branches over the whole path."""
    x_low, x_high = float(motion.x.min()) - 1.4, float(motion.x.max()) + 0.3
    y_low, y_high = float(motion.y.min()) - 0.5, float(motion.y.max()) + 1.0
    layers = []
    for _ in range(int(rng.integers(1, 3))):
        branches = int(rng.uniform(2.0, 6.0) * (x_high - x_low) * (y_high - y_low)) + 1
        size = rng.uniform(0.015, 0.09)
        cover_m2 = between(rng, recipe.leaf_cover) * (x_high - x_low) * (y_high - y_low)
        count = int(min(cover_m2 / (1.8 * size**2), 2500)) + 1
        middles = rng.uniform((x_low, y_low), (x_high, y_high), (branches, 2))
        directions, lengths = rng.uniform(0, np.pi, branches), rng.uniform(0.1, 0.7, branches)
        branch = rng.integers(0, branches, count)
        place = rng.uniform(-1.0, 1.0, count) * lengths[branch]
        line = np.column_stack((np.cos(directions[branch]), np.sin(directions[branch])))
        centres = middles[branch] + place[:, None] * line + rng.normal(0.0, 0.06, (count, 2))
        long = size * np.exp(rng.normal(0.0, 0.3, count))
        layers.append(
            Foliage(
                centres,
                np.column_stack((long, long * rng.uniform(0.25, 0.9))),
                rng.uniform(-np.pi, np.pi, count),
                branch,
                rng.uniform(0.003, 0.05),
                rng.uniform(0.05, 0.5),
                rng.uniform(0, 2 * np.pi, (branches, 2)),
                rng.uniform(0.8, 4.0, (branches, 2)),
                rng.uniform(0.4, 4.0),
                rng.uniform(0.7, 1.0),
            )
        )
    return tuple(layers)


def _draw_cloud(rng: np.random.Generator, recipe: Recipe, count: int) -> Points:
    if rng.uniform() >= recipe.clouds:
        return np.ones(count)
    wave = smooth_noise(rng, count, rng.uniform(1.0, 6.0)) + rng.uniform(0.0, 1.0)
    return np.asarray(np.clip(0.5 + rng.uniform(0.4, 1.5) * wave, 0.05, 1.0), np.float64)


def _draw_sensor(rng: np.random.Generator, recipe: Recipe) -> Sensor:
    hunts = rng.uniform() < recipe.hunting
    noise = between(rng, recipe.noise)
    return Sensor(
        target=between(rng, recipe.exposure),
        rate=rng.uniform(0.5, 0.75) if hunts else rng.uniform(0.05, 0.35),
        delay=int(rng.integers(1, 3)) if hunts else 0,
        blur_s=1e-3 * between(rng, recipe.blur_ms),
        read=0.4 * noise,
        shot=2.0 * noise,
        vignetting=rng.uniform(0.05, 0.45),
        softness_px=rng.uniform(0.3, 0.8),
        jpeg_quality=whole(rng, recipe.jpeg),
        tint=rng.uniform(0.92, 1.08, 3),
    )


def _draw_compass(rng: np.random.Generator, count: int) -> Points:
    """Return the slow disturbance of the compass every 10 ms, rad: iron in ground and rover."""
    return np.asarray(np.radians(rng.uniform(0.1, 0.8)) * smooth_noise(rng, count, 6.0), np.float64)


def _draw_sensors(rng: np.random.Generator) -> Sensors:
    return Sensors(
        wheel_noise=rng.uniform(0.001, 0.006),
        wheel_scale=rng.normal(0.0, 0.004),
        compass_noise_deg=rng.uniform(0.2, 0.6),
        compass_offset_deg=rng.normal(0.0, 0.8),
        gyro_noise_dps=rng.uniform(0.05, 0.2),
        gyro_offset_dps=tuple(rng.normal(0.0, 0.08, 3).tolist()),
    )
