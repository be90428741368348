"""The compiled inner loops: ground, ruts, light and the view through the lens.

Maps are square, `MAP_SIZE` texels wide, and store the texel (i, j) of the world at (i, j) modulo their width.
All compiled functions are in this file: numba's cache does not detect changes in another.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_backends.arrays import Array
from sim_backends.jit import compiled

Map: TypeAlias = NDArray[np.float32]
LightMap: TypeAlias = NDArray[np.uint16]
Flags: TypeAlias = NDArray[np.bool_]
Box: TypeAlias = NDArray[np.int64]

MEAN_REFLECTANCE = 0.42
MAP_SIZE = 2048
BLOCK = 32
"""Ground is generated and illuminated in blocks of this many texels."""
LIGHT_STEPS = 64.0
"""Units of the light map in a grey level."""
SHADOW_STEPS = 20
SHADOW_STRETCH = 0.15
"""The line to the sun is sampled at k + stretch k^2 texels."""
TALLEST_M = 0.06
"""Greatest height of small obstacles above the ground that they shade."""
HOLLOW_M = 0.012
CONTACT_M = 0.02
"""Half the length of the contact; relevant for a wheel dragged sideways."""
BERM_REACH = 4.0
LUG_SHARE = 0.28
"""Share of the lug pitch covered by the lug's imprint."""
ROUGH_TEXEL_M = 0.0023
HIT_STEPS = 2
FLATTEST_RAY = 0.25
MASK = MAP_SIZE - 1
BLOCK_MASK = MAP_SIZE // BLOCK - 1

_compiled = compiled(fastmath=True)


class Maps(NamedTuple):
    """The ground around the rover.

    Attributes:
        height: Height in the world, m.
        reflectance: Share of the light reflected.
        light: Reflected light of sky and sun, in 1 / `LIGHT_STEPS`.
        is_dark: Blocks whose light must be recomputed.
        texel_m: Width of a texel.
    """

    height: Map
    reflectance: Map
    light: LightMap
    is_dark: Flags
    texel_m: float


class GroundModel(NamedTuple):
    """Sources of the undisturbed ground.

    Attributes:
        slope: Rise along x and y, m per m.
        mounds: Rows x, y, height, radius in m.
        reflectance: A tile of the ground, as is `relief` in m.
        patches: Slow variation of brightness, unit variance.
        tile_placement: Cosine, sine of the tile's turn, its texel in m, that of the patches, their strength.
        roughness: Fine roughness of pressed ground, unit variance.
        light_reach: Rows of offsets, in texels, of the ground whose light a change of the ground affects.
    """

    slope: Array
    mounds: Array
    reflectance: Map
    relief: Map
    patches: Map
    tile_placement: Array
    roughness: Map
    light_reach: Box


class View(NamedTuple):
    """Camera and shadow for one image. Tuples: the compiler keeps their values in the loop over the pixels.

    Attributes:
        rays: x / z, y / z and the lens's brightness for each pixel.
        cameras: Position of the camera in the world for each line of the image, m.
        turns: Rotation from camera to world for each line, row by row.
        plane: a, b, c of undisturbed ground near the view, z = a x + b y + c, m.
        shade: Share of the sun blocked by the rover, on that plane.
        shade_frame: Two rows that take world x, y, 1 to texels of `shade`; then x / z and y / z of the sun.
        canopy: A tile of the share of the sun blocked by leaves or clouds.
        canopy_frame: Texels in a metre, and the texel at the origin of the world.
        tint: Blue, green, red of the sky, then of the sun.
        curve: Grey level of the camera for 0 ... 256 units of light, evenly spaced.
    """

    rays: Map
    cameras: Array
    turns: Array
    plane: tuple[float, ...]
    shade: Map
    shade_frame: tuple[float, ...]
    canopy: Map
    canopy_frame: tuple[float, ...]
    tint: tuple[float, ...]
    curve: NDArray[np.uint8]


@_compiled
def terrain_m(x_m: float, y_m: float, slope: Array, mounds: Array) -> float:
    """Return the height of the undisturbed ground without its relief."""
    height: float = slope[0] * x_m + slope[1] * y_m
    for k in range(mounds.shape[0]):
        square = (x_m - mounds[k, 0]) ** 2 + (y_m - mounds[k, 1]) ** 2
        height += mounds[k, 2] * math.exp(-0.5 * square / mounds[k, 3] ** 2)
    return height


@_compiled
def _sample(tile: Map, u: float, v: float) -> float:
    """Return the tile at the texel coordinates u (row), v (column), bilinear and periodic."""
    mask = tile.shape[0] - 1
    fu, fv = math.floor(u), math.floor(v)
    du, dv = u - fu, v - fv
    i, j = fu & mask, fv & mask
    k, m = (i + 1) & mask, (j + 1) & mask
    upper: float = tile[i, j] * (1 - dv) + tile[i, m] * dv
    lower: float = tile[k, j] * (1 - dv) + tile[k, m] * dv
    return upper * (1 - du) + lower * du


@_compiled
def fill(maps: Maps, box: Box, model: GroundModel) -> None:
    """Fill the box with undisturbed ground: first and end row, first and end column."""
    cosine, sine, tile_m, patch_m, strength = model.tile_placement
    for i in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            x, y = (i + 0.5) * maps.texel_m, (j + 0.5) * maps.texel_m
            u, v = (cosine * x - sine * y) / tile_m, (sine * x + cosine * y) / tile_m
            patch = max(0.3, 1 + strength * _sample(model.patches, x / patch_m, y / patch_m))
            row, column = i & MASK, j & MASK
            maps.reflectance[row, column] = _sample(model.reflectance, u, v) * patch
            relief = _sample(model.relief, u, v)
            maps.height[row, column] = terrain_m(x, y, model.slope, model.mounds) + relief


@_compiled
def add_stone(maps: Maps, box: Box, stone: Array) -> None:
    """Add a stone to the ground: x, y, half axes, rotation (rad), height, m; reflectance."""
    x0, y0, along, across, turn, top, tone = stone
    cosine, sine = math.cos(turn), math.sin(turn)
    for i in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            x, y = (i + 0.5) * maps.texel_m - x0, (j + 0.5) * maps.texel_m - y0
            square = ((cosine * x + sine * y) / along) ** 2 + ((cosine * y - sine * x) / across) ** 2
            if square < 1:
                row, column = i & MASK, j & MASK
                maps.height[row, column] += top * (1 - square) ** 0.7
                pattern = 0.7 + 0.3 * maps.reflectance[row, column] / MEAN_REFLECTANCE
                maps.reflectance[row, column] = tone * pattern


@_compiled
def press(maps: Maps, box: Box, roll: Array, rut: Array, model: GroundModel) -> None:
    """Press the strip of ground that a wheel's lowest line passes over in one short step.

    `roll`: contact x, y before, displacement forward and to the left of the wheel's heading (m), cosine and
    sine of that heading, wheel angle before and after in lug pitches. `rut`: see `_pressed`.
    """
    x0, y0, forward, left, cosine, sine, lug0, lug1 = roll
    # The floor may be pressed twice, so its strips overlap slightly; berms accumulate, so theirs must not.
    first, last = min(0.0, forward), max(0.0, forward)
    overlap = 0.6 * maps.texel_m + CONTACT_M * abs(left) / (abs(left) + abs(forward) + 1e-9)
    scale = 1 / forward if abs(forward) > 1e-6 else 0.0
    for i in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            x, y = (i + 0.5) * maps.texel_m, (j + 0.5) * maps.texel_m
            along = cosine * (x - x0) + sine * (y - y0)
            part = along * scale
            n = cosine * (y - y0) - sine * (x - x0) - left * min(max(part, 0.0), 1.0)
            reach = rut[0] + BERM_REACH * rut[5] if first < along <= last else rut[0]
            if along < first - overlap or along > last + overlap or abs(n) > reach:
                continue
            roughness = _sample(model.roughness, x / ROUGH_TEXEL_M, y / ROUGH_TEXEL_M)
            ground = terrain_m(x, y, model.slope, model.mounds)
            row, column = i & MASK, j & MASK
            old = maps.height[row, column], maps.reflectance[row, column]
            new = _pressed(old, n, ground, roughness, lug0 + (lug1 - lug0) * part, rut)
            maps.height[row, column], maps.reflectance[row, column] = new
            _darken(maps.is_dark, i, j, model.light_reach)


@_compiled
def _darken(is_dark: Flags, i: int, j: int, light_reach: Box) -> None:
    for k in range(light_reach.shape[0]):
        is_dark[
            ((i + light_reach[k, 0]) // BLOCK) & BLOCK_MASK, ((j + light_reach[k, 1]) // BLOCK) & BLOCK_MASK
        ] = True


@_compiled
def _pressed(
    old: tuple[float, float], n: float, ground: float, roughness: float, lugs: float, rut: Array
) -> tuple[float, float]:
    """Return height and reflectance after the wheel at `n` m to the left of its middle.

    `rut`: half width, depth, width of the wall, height of the berm left and right, its width, depth of the
    lugs (m), reflectance of the floor, its share in the new reflectance.
    """
    half, depth, wall, berm_left, berm_right, berm_m, lug_m, tone, share = rut
    height, reflectance = old
    edge = min(abs(n) - half + 0.0012 * roughness, BERM_REACH * berm_m)
    if edge > 0:
        berm = berm_left if n > 0 else berm_right
        shape = (edge / berm_m) * math.exp(1 - edge / berm_m) * (1 - edge / (BERM_REACH * berm_m))
        rise = berm * shape * (1 + 0.15 * roughness)
        fresh = 0.35 * shape * berm / (berm + 0.003)
        loose = 0.93 * MEAN_REFLECTANCE
        return height + max(0.0, rise - max(0.0, height - ground)), reflectance + fresh * (
            loose - reflectance
        )
    inside = min(-edge / wall, 1.0)
    inside = inside * inside * (3 - 2 * inside)
    phase = lugs - math.floor(lugs)
    lug = 0.25 * lug_m
    if phase < LUG_SHARE:
        lug -= lug_m * math.sin(math.pi * phase / LUG_SHARE)
    floor = ground - depth + inside * (lug + 0.0004 * roughness)
    wanted = tone * (1 + 0.04 * roughness)
    return height + inside * (floor - height), reflectance + share * inside * (wanted - reflectance)


@_compiled
def illuminate(maps: Maps, box: Box, sun: Array, bands: Array) -> None:
    """Compute the light of sky and sun on the ground in the box.

    `sun`: direction x, y, z; light of white ground perpendicular to the sun, and under the sky.
    `bands`: shadows of distant poles and walls; rows of normal x, y, offset, half width, softness in m.
    """
    height, texel_m = maps.height, maps.texel_m
    hollow = int(HOLLOW_M / texel_m)
    for i in range(box[0], box[1]):
        for j in range(box[2], box[3]):
            row, column = i & MASK, j & MASK
            slope_x = (height[(i + 1) & MASK, column] - height[(i - 1) & MASK, column]) / (2 * texel_m)
            slope_y = (height[row, (j + 1) & MASK] - height[row, (j - 1) & MASK]) / (2 * texel_m)
            upright = 1 / math.sqrt(1 + slope_x * slope_x + slope_y * slope_y)
            direct = max(0.0, (sun[2] - sun[0] * slope_x - sun[1] * slope_y) * upright)
            if direct > 0:
                direct *= _sun_share(height, i, j, texel_m, sun)
                direct *= _band_light((i + 0.5) * texel_m, (j + 0.5) * texel_m, bands)
            around = height[(i + hollow) & MASK, column] + height[(i - hollow) & MASK, column]
            around += height[row, (j + hollow) & MASK] + height[row, (j - hollow) & MASK]
            hollow_depth = max(0.0, 0.25 * around - height[row, column]) / HOLLOW_M
            # Surrounding walls hide part of the sky; the constant is chosen.
            sky_share = max(0.3, (0.5 + 0.5 * upright) * (1 - 0.6 * hollow_depth))
            tone = maps.reflectance[row, column] * LIGHT_STEPS
            maps.light[row, column, 0] = np.uint16(min(tone * sun[4] * sky_share, 65535.0))
            maps.light[row, column, 1] = np.uint16(min(tone * sun[3] * direct, 65535.0))


@_compiled
def _sun_share(height: Map, i: int, j: int, texel_m: float, sun: Array) -> float:
    """Return the share of the sun that the surrounding ground does not block from a texel."""
    level = math.hypot(sun[0], sun[1])
    rise, step_x, step_y = sun[2] / level, sun[0] / level, sun[1] / level
    here, hidden = height[i & MASK, j & MASK], 0.0
    for k in range(1, SHADOW_STEPS):
        far = k + SHADOW_STRETCH * k * k
        if far * texel_m * rise > TALLEST_M:
            break
        m, n = (i + round(step_x * far)) & MASK, (j + round(step_y * far)) & MASK
        hidden = max(hidden, (height[m, n] - here) / (far * texel_m) - rise)
    return max(0.0, 1 - hidden / 0.15)


@_compiled
def _band_light(x: float, y: float, bands: Array) -> float:
    share = 1.0
    for k in range(bands.shape[0]):
        across = abs(bands[k, 0] * x + bands[k, 1] * y - bands[k, 2]) - bands[k, 3]
        share *= min(max(0.5 + 0.5 * across / bands[k, 4], 0.0), 1.0)
    return share


@_compiled
def render(image: NDArray[np.uint8], maps: Maps, view: View) -> None:
    """Render the image, blue, green, red."""
    a, b, c = view.plane
    brightest, unit = view.curve.shape[0] - 1.0, view.curve.shape[0] / 256 / LIGHT_STEPS
    texels = 1 / maps.texel_m
    canopied = view.canopy.shape[0] > 1
    for row in range(image.shape[0]):
        turn = _nine(view.turns[row])
        camera = view.cameras[row, 0], view.cameras[row, 1], view.cameras[row, 2]
        base = camera[2] - a * camera[0] - b * camera[1] - c
        over = 0.0
        for column in range(image.shape[1]):
            u, v = view.rays[row, column, 0], view.rays[row, column, 1]
            dx = turn[0] * u + turn[1] * v + turn[2]
            dy = turn[3] * u + turn[4] * v + turn[5]
            dz = turn[6] * u + turn[7] * v + turn[8]
            # Rays that do not meet the ground within its map show its farthest part.
            per_fall = 1 / max(a * dx + b * dy - dz, FLATTEST_RAY)
            # The ground height is close to that of the neighbouring pixel: a few steps find the intersection.
            for _ in range(HIT_STEPS):
                distance = (base - over) * per_fall
                x, y = camera[0] + distance * dx, camera[1] + distance * dy
                over = _height_at(maps.height, x * texels, y * texels) - a * x - b * y - c
            distance = (base - over) * per_fall
            x, y = camera[0] + distance * dx, camera[1] + distance * dy
            sky, sun = _light_at(maps.light, x * texels - 0.5, y * texels - 0.5)
            sun *= 1 - _rover_shadow(view, x - over * view.shade_frame[6], y - over * view.shade_frame[7])
            if canopied:
                per_m, u0, v0 = view.canopy_frame
                sun *= 1 - _sample(view.canopy, x * per_m + u0, y * per_m + v0)
            lens = view.rays[row, column, 2] * unit
            sky *= lens
            sun *= lens
            for colour in range(3):
                light = view.tint[colour] * sky + view.tint[colour + 3] * sun
                image[row, column, colour] = view.curve[int(min(light, brightest))]


@_compiled
def _nine(m: Array) -> tuple[float, float, float, float, float, float, float, float, float]:
    return m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]


@_compiled
def _height_at(heights: Map, u: float, v: float) -> float:
    height: float = heights[math.floor(u) & MASK, math.floor(v) & MASK]
    return height


@_compiled
def _light_at(light: LightMap, u: float, v: float) -> tuple[float, float]:
    """Return the light of sky and sun at the texel coordinates u (row), v (column), bilinear."""
    fu, fv = math.floor(u), math.floor(v)
    du, dv = u - fu, v - fv
    i, j = fu & MASK, fv & MASK
    k, m = (i + 1) & MASK, (j + 1) & MASK
    w00, w01, w10, w11 = (1 - du) * (1 - dv), (1 - du) * dv, du * (1 - dv), du * dv
    sky = w00 * light[i, j, 0] + w01 * light[i, m, 0] + w10 * light[k, j, 0] + w11 * light[k, m, 0]
    sun = w00 * light[i, j, 1] + w01 * light[i, m, 1] + w10 * light[k, j, 1] + w11 * light[k, m, 1]
    return sky, sun


@_compiled
def _rover_shadow(view: View, x: float, y: float) -> float:
    """Return the share of the sun that the rover blocks from a point of the plane."""
    shade, frame = view.shade, view.shade_frame
    s = frame[0] * x + frame[1] * y + frame[2]
    t = frame[3] * x + frame[4] * y + frame[5]
    if not (0 <= s < shade.shape[0] - 1 and 0 <= t < shade.shape[0] - 1):
        return 0.0
    i, j = int(s), int(t)
    ds, dt = s - i, t - j
    near: float = shade[i, j] * (1 - dt) + shade[i, j + 1] * dt
    far: float = shade[i + 1, j] * (1 - dt) + shade[i + 1, j + 1] * dt
    dark: float = near * (1 - ds) + far * ds
    return dark
