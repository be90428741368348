"""Forces on a wheel at any slip angle, from rolling to sliding sideways: an extension of paper 001.

Paper 001's integrals (its eqs 6 to 25) hold for a rolling wheel. Here the wheel may also be locked, spin in
place or slide sideways (slip angle 90 degrees), so the equations use speeds instead of slip ratios. The
pressure on each element of the rim is a weighted mean of two laws; the weight depends on how much the rim
presses the soil down:

- pressed: k z^n of a plate, greatest at a_0 theta_f and shrinking behind it as in paper 001's eq 17;
- pushed or slid over: rho g z times a number that is small where soil slides past, large where the rim
  pushes the soil ahead, and decreases to zero where the rim moves away from the soil.

The weight is (downward speed of the rim's surface over its speed)^q times (share of forward travel)^(2 b):
soil that is dragged along or sheared sideways carries less than under a plate. One mechanism thus gives
slip sinkage, skid sinkage and the deep trench of sliding sideways. Shear stress builds up over the shear
displacement (eqs 19 to 24), points against the slip velocity, and fades where the rim moves straight into the
soil. The leading side wall meets passive pressure in proportion to depth, and friction against its motion in
its own plane. Lugs shear at r + lambda_s h (paper 002, eq 8), with the soil's own friction.

Not modelled: soil piled up ahead, the trench's shape, soil thrown by lugs, contact of hub and fork at great
sinkage, and asymmetry of a test rig.
"""

import itertools
import math
from importlib import resources
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np

from drivers.errors import ConfigError, ModelError
from drivers.files import read_text
from drivers.settings import Settings
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.library import BekkerLaw, SoilSettings, WheelSettings, parse_settings
from sim_backends.terramechanics.soil.quantity import check_range, quantity

DEEPEST = 1.85
"""Greatest sinkage considered, in radii."""
BISECTIONS = 30
RIM_NODES, RIM_WEIGHTS = np.polynomial.legendre.leggauss(10)
DEPTH_NODES, DEPTH_WEIGHTS = np.polynomial.legendre.leggauss(4)
TINY = 1e-9
GREATEST_STRESS_BY_SLIP = 0.15
"""a_1 of paper 001, Table III, which this law does not have (eq 18)."""


class AnyAngleSoil(Settings):
    """Parameters of a soil, and of a wheel surface on it, for wheels at any slip angle.

    Attributes:
        source: Origin of the numbers.
        plate_modulus_pa: k of a plate's pressure k z^n, Pa / m^n.
        plate_exponent: n.
        density_kg_m3: In bulk.
        friction_angle_deg: Friction within the soil; applies to lugs where it exceeds `rim_friction_deg`.
        rim_friction_deg: Friction between soil and smooth rim.
        shear_modulus_m: Displacement over which shear stress builds up (paper 001, eq 19).
        greatest_stress: a_0, angle of greatest stress over entry angle (eq 18).
        exit_share: lambda, height behind the wheel at which it leaves the soil, over the sinkage (eq 16).
        slide_number: Pressure over rho g z where soil slides past the rim.
        push_number: Added to it where the rim pushes straight ahead.
        wake_rate: Rate of its decrease where the rim moves away from the soil.
        press_exponent: q, exponent of the weight of the pressed law.
        sideways_exponent: b, its other exponent.
        wall_number: Pressure over rho g z on the leading side wall.
        wall_exponent: Power of (sideways speed over speed) by which it is scaled.
        wall_friction: Friction over pressure on the side wall.
        wall_drag: Force backward over the force on the side wall. A wheel that slides straight sideways
            without turning should have none, by symmetry; the CMU test bed measured 0.13.
        not_fitted: Keys whose numbers are not of tests of this soil.
        not_fitted_from: The soil that they are of.
    """

    source: str
    plate_modulus_pa: Annotated[float, quantity("Pa/m^n", 1e3, 1e12)]
    plate_exponent: Annotated[float, quantity("1", 0.2, 4.0)]
    density_kg_m3: Annotated[float, quantity("kg/m^3", 100.0, 10_000.0)]
    friction_angle_deg: Annotated[float, quantity("deg", 1.0, 60.0)]
    rim_friction_deg: Annotated[float, quantity("deg", 1.0, 60.0)]
    shear_modulus_m: Annotated[float, quantity("m", 1e-5, 1.0)]
    greatest_stress: Annotated[float, quantity("1", 0.0, 0.95)]
    exit_share: Annotated[float, quantity("1", 0.0, 1.0)]
    slide_number: Annotated[float, quantity("1", 0.0, 1000.0)]
    push_number: Annotated[float, quantity("1", 0.0, 1000.0)]
    wake_rate: Annotated[float, quantity("1", 0.0, 1000.0)]
    press_exponent: Annotated[float, quantity("1", 0.0, 10.0)]
    sideways_exponent: Annotated[float, quantity("1", 0.0, 10.0)]
    wall_number: Annotated[float, quantity("1", 0.0, 1000.0)]
    wall_exponent: Annotated[float, quantity("1", 0.0, 10.0)]
    wall_friction: Annotated[float, quantity("1", 0.0, 2.0)]
    wall_drag: Annotated[float, quantity("1", -1.0, 1.0)] = 0.0
    not_fitted: tuple[str, ...] = ()
    not_fitted_from: str = ""

    def for_rolling(self) -> SoilSettings:
        """Return the soil for the law of paper 001, which has no numbers for sliding sideways.

        Both laws share the plates' k and n, density, friction, shear modulus, angle of greatest stress, exit
        height and the friction at the side wall, there at most 45 deg. A soil of this law has no cohesion and
        no a_1: that of the paper's sand is taken.
        """
        return SoilSettings(
            source=self.source,
            cohesion_pa=0.0,
            friction_angle_deg=self.friction_angle_deg,
            density_kg_m3=self.density_kg_m3,
            pressure=BekkerLaw(
                law="bekker", k_c_pa_m=0.0, k_phi_pa=self.plate_modulus_pa, exponent=self.plate_exponent
            ),
            shear_modulus_m=self.shear_modulus_m,
            greatest_stress=(self.greatest_stress, GREATEST_STRESS_BY_SLIP),
            exit_polynomial=(self.exit_share, 0.0, 0.0),
            wall_friction_deg=min(math.degrees(math.atan(self.wall_friction)), 45.0),
        )


def load_any_angle_soil(name: str | Path) -> AnyAngleSoil:
    """Return a soil of the library by name (`cmu_sand`, `cmu_sand_blind`), or of a TOML file by path.

    Raises:
        ConfigError: The soil is unknown, the file is not TOML, or a number is outside its range.
    """
    path = Path(name)
    if path.suffix != ".toml":
        library = resources.files("sim_backends.terramechanics.soil") / "library"
        path = Path(str(library / "any_angle" / f"{name}.toml"))
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"soil '{name}': cannot be read ({error}); give a .toml file.") from None
    return parse_settings(text, str(name), AnyAngleSoil)


class Motion(NamedTuple):
    """Motion of the wheel; arrays of one length. Only ratios of the speeds matter.

    Attributes:
        rim_speed_m_s: Wheel speed times the radius of the rim without lugs; at least 0.
        forward_m_s: Speed of the axle along the wheel; at least 0.
        sideways_m_s: Speed of the axle to the left.
    """

    rim_speed_m_s: Array
    forward_m_s: Array
    sideways_m_s: Array


class AnyAngleForces(NamedTuple):
    """Forces of the soil on the wheel; arrays of one length.

    Attributes:
        drawbar_n: Force forward.
        side_n: Force to the left.
        vertical_n: Force upward.
        torque_nm: Torque required from the drive.
    """

    drawbar_n: Array
    side_n: Array
    vertical_n: Array
    torque_nm: Array


def shearing_radius_m(wheel: WheelSettings) -> float:
    """Return r_s, at which the soil shears (paper 002, eq 8)."""
    return wheel.radius_m + wheel.shearing_share * wheel.lug_height_m


def deepest_sinkage_m(wheel: WheelSettings) -> float:
    """Return the greatest sinkage considered by the law."""
    return DEEPEST * shearing_radius_m(wheel)


def any_angle_forces(
    wheel: WheelSettings, soil: AnyAngleSoil, motion: Motion, sinkage_m: Array
) -> AnyAngleForces:
    """Return the forces at given sinkages.

    Args:
        wheel: With or without lugs.
        soil: Parameters of the soil.
        motion: Speeds; not all of them 0.
        sinkage_m: Below the undisturbed surface; above 0, up to 1.85 radii.

    Raises:
        ModelError: A number is out of range.
    """
    check_range("sinkage_m", sinkage_m, "m", 0.0, deepest_sinkage_m(wheel))
    return _forces(wheel, soil, _checked(motion), np.maximum(np.asarray(sinkage_m, dtype=np.float64), TINY))


def any_angle_at_load(
    wheel: WheelSettings, soil: AnyAngleSoil, motion: Motion, load_n: Array
) -> tuple[Array, AnyAngleForces]:
    """Return the sinkages in m at which the soil carries given loads, and the forces there.

    NaN where the soil cannot carry the load before the wheel is 1.85 radii deep.

    Args:
        wheel: With or without lugs.
        soil: Parameters of the soil.
        motion: Speeds; not all of them 0.
        load_n: Vertical load, above 0.

    Raises:
        ModelError: A number is out of range.
    """
    check_range("load_n", load_n, "N", 1e-6, 1e7)
    motion = _checked(motion)
    load = np.broadcast_to(np.asarray(load_n, dtype=np.float64), motion.forward_m_s.shape)
    deepest = deepest_sinkage_m(wheel)
    low, high = np.full(load.shape, TINY), np.full(load.shape, deepest)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        is_too_light = _forces(wheel, soil, motion, middle).vertical_n < load
        low, high = np.where(is_too_light, middle, low), np.where(is_too_light, high, middle)
    is_carried = high < deepest
    sinkage = np.where(is_carried, 0.5 * (low + high), np.nan)
    forces = _forces(wheel, soil, motion, np.where(is_carried, sinkage, deepest))
    return sinkage, AnyAngleForces(*(np.where(is_carried, values, np.nan) for values in forces))


def _checked(motion: Motion) -> Motion:
    """Return the motion as arrays of one shape, its greatest speed 1."""
    check_range("rim_speed_m_s", motion.rim_speed_m_s, "m/s", 0.0, 100.0)
    check_range("forward_m_s", motion.forward_m_s, "m/s", 0.0, 100.0)
    check_range("sideways_m_s", motion.sideways_m_s, "m/s", -100.0, 100.0)
    rim, forward, sideways = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(x, dtype=np.float64)) for x in motion)
    )
    greatest = np.maximum(np.maximum(rim, forward), np.abs(sideways))
    if np.any(greatest == 0):
        raise ModelError(
            "rim_speed_m_s, forward_m_s and sideways_m_s are all 0 m/s: a wheel at rest has no slip"
        )
    return Motion(rim / greatest, forward / greatest, sideways / greatest)


def _forces(wheel: WheelSettings, soil: AnyAngleSoil, motion: Motion, sinkage: Array) -> AnyAngleForces:
    radius = shearing_radius_m(wheel)
    surface = motion._replace(rim_speed_m_s=motion.rim_speed_m_s * radius / wheel.radius_m)
    rim = _rim_forces(wheel, soil, surface, sinkage, radius)
    wall = _wall_forces(soil, surface, sinkage, radius)
    return AnyAngleForces(*(a + b for a, b in zip(rim, wall, strict=True)))


class _Rim:
    """Geometry and speeds of the rim as functions of the angle; columns are pieces, rows are wheels."""

    def __init__(self, soil: AnyAngleSoil, motion: Motion, sinkage: Array, radius: float) -> None:
        self.soil = soil
        self.radius = radius
        self.turning, self.forward, self.sideways = (values[:, None] for values in motion)
        self.entry = np.arccos(1 - sinkage / radius)[:, None]
        self.leaving = -np.arccos(1 - soil.exit_share * sinkage / radius)[:, None]
        self.greatest = soil.greatest_stress * self.entry
        travel = np.hypot(self.forward, self.sideways)
        share = np.where(travel > 0, self.forward / np.maximum(travel, TINY), 1.0)
        self.forward_share: Array = share ** (2 * soil.sideways_exponent)

    def depth(self, angle: Array) -> Array:
        """Return the depth of the rim below the surface, m."""
        return np.maximum(self.radius * (np.cos(angle) - np.cos(self.entry)), 0.0)

    def speed(self, angle: Array) -> Array:
        """Return the speed of the rim's surface against the soil."""
        along = self.turning - self.forward * np.cos(angle)
        square = along**2 + (self.forward * np.sin(angle)) ** 2 + self.sideways**2
        return np.maximum(np.sqrt(square), TINY)

    def pressed_share(self, angle: Array) -> Array:
        """Return the weight of the plate's pressure law, 0 to 1."""
        down = np.clip(self.turning * np.sin(angle) / self.speed(angle), 0.0, 1.0)
        weight: Array = down**self.soil.press_exponent * self.forward_share
        return weight

    def mirrored(self, angle: Array) -> Array:
        """Return the angle ahead of the greatest stress that has the same stress (paper 001, eq 17)."""
        share = (angle - self.leaving) / np.maximum(self.greatest - self.leaving, TINY)
        behind = self.entry - share * (self.entry - self.greatest)
        return np.where(angle >= self.greatest, angle, behind)

    def pressure(self, angle: Array) -> Array:
        """Return the normal stress, Pa."""
        soil = self.soil
        equivalent = self.mirrored(angle)
        pressed = np.where(angle >= self.leaving, self.pressed_share(equivalent), 0.0)
        push = self.forward * np.sin(angle) / self.speed(angle)
        number = soil.slide_number * np.clip(1 + soil.wake_rate * push, 0.0, 1.0)
        number = number + soil.push_number * np.maximum(push, 0.0)
        slid = soil.density_kg_m3 * STANDARD_GRAVITY_M_S2 * self.depth(angle) * number
        plate = soil.plate_modulus_pa * self.depth(equivalent) ** soil.plate_exponent
        return pressed * plate + (1 - pressed) * slid

    def mobilised(self, angle: Array) -> Array:
        """Return the share of the shear strength mobilised by the shear displacement (eqs 19 to 21)."""
        swept = self.entry - angle
        turning = np.maximum(self.turning, TINY)
        along = self.radius * (swept - self.forward / turning * (np.sin(self.entry) - np.sin(angle)))
        across = self.radius * swept * self.sideways / turning
        share: Array = -np.expm1(-np.hypot(along, across) / self.soil.shear_modulus_m)
        return share


def _rim_forces(
    wheel: WheelSettings, soil: AnyAngleSoil, motion: Motion, sinkage: Array, radius: float
) -> AnyAngleForces:
    rim = _Rim(soil, motion, sinkage, radius)
    friction = np.tan(np.radians(_friction_deg(wheel, soil)))
    total = np.zeros((4, len(sinkage)))
    edges = (-rim.entry, rim.leaving, rim.greatest, rim.entry)
    for start, end in itertools.pairwise(edges):
        angle = 0.5 * (start + end) + 0.5 * (end - start) * RIM_NODES
        area = 0.5 * (end - start) * RIM_WEIGHTS * radius * wheel.width_m
        pressure = rim.pressure(angle)
        shear = pressure * friction * rim.mobilised(angle)
        along = rim.turning - rim.forward * np.cos(angle)
        speed = rim.speed(angle)
        tangential, lateral = shear * along / speed, -shear * rim.sideways / speed
        total[0] += np.sum(area * (tangential * np.cos(angle) - pressure * np.sin(angle)), axis=1)
        total[1] += np.sum(area * lateral, axis=1)
        total[2] += np.sum(area * (tangential * np.sin(angle) + pressure * np.cos(angle)), axis=1)
        total[3] += np.sum(area * tangential, axis=1) * radius
    return AnyAngleForces(*total)


def _friction_deg(wheel: WheelSettings, soil: AnyAngleSoil) -> float:
    # Lugs shear soil on soil, which is at least as strong as soil on the rim.
    lugs = wheel.lug_height_m > 0
    return max(soil.friction_angle_deg, soil.rim_friction_deg) if lugs else soil.rim_friction_deg


def _wall_forces(soil: AnyAngleSoil, motion: Motion, sinkage: Array, radius: float) -> AnyAngleForces:
    """Return the forces on the leading side wall; the other has no soil contact."""
    turning, forward, sideways = (values[:, None, None] for values in motion)
    entry = np.arccos(1 - sinkage / radius)
    angle = (entry[:, None] * RIM_NODES)[:, :, None]
    column = radius * (np.cos(angle) - np.cos(entry)[:, None, None])
    depth = 0.5 * column * (1 + DEPTH_NODES)
    # Beyond a right angle cos is negative: columns above the axle are counted once.
    area = entry[:, None, None] * RIM_WEIGHTS[:, None] * radius * np.cos(angle) * 0.5 * column * DEPTH_WEIGHTS
    ahead, below = radius * np.sin(angle), radius * np.cos(angle) - column + depth
    along, down = forward - turning * below / radius, turning * ahead / radius
    speed = np.maximum(np.sqrt(along**2 + down**2 + sideways**2), TINY)
    push = soil.wall_number * soil.density_kg_m3 * STANDARD_GRAVITY_M_S2 * depth
    push = push * (np.abs(sideways) / speed) ** soil.wall_exponent * (sideways != 0)
    back, up = (soil.wall_friction * push * part / speed for part in (along, down))
    drive = (up * ahead - back * below) * area
    side = np.sum(push * area, axis=(1, 2))
    return AnyAngleForces(
        -np.sum(back * area, axis=(1, 2)) - soil.wall_drag * side,
        -np.sign(motion.sideways_m_s) * side,
        np.sum(up * area, axis=(1, 2)),
        np.sum(drive, axis=(1, 2)),
    )
