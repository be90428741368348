"""Two field drives of a four-wheel rover on sand, written from force balance: truth for its odometry.

The rover stands on four contacts of a height field. Each wheel pulls along its slip velocity (rim minus
ground, over the rim speed), as strong as a hyperbola of that velocity allows; a wall of sand resists
sideways, and the rolling resistance grows with slip, as sinkage does. Slip and drift angle are those at
which the four wheels together carry the weight. It knows nothing of the estimator: neither its slip law nor
its filter.

Sensors: fluxgate compass (bias, error over heading, lag, noise), gyro (bias, noise), inclinometer noise,
trace angle of the rear left wheel at 5 Hz (correlated noise, drop-outs in runs of one to three).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Columns = dict[str, Array]

GRAVITY = 9.81
CONTACTS = ((0.30, 0.22), (0.30, -0.22), (-0.30, 0.22), (-0.30, -0.22))
"""Front left, front right, rear left, rear right."""
CENTRE_HEIGHT_M = 0.28
RADIUS_M = 0.092
STEP_S = 0.05
REST_S = 2.0
TRACE_STEPS = 4
TRUTH = (
    "t_s",
    "x_m",
    "y_m",
    "yaw_rad",
    "slip",
    "slip_angle_rad",
    "pitch_rad",
    "roll_rad",
    "turned",
    "rate",
    "ahead",
)
COMPASS_STEPS = 2


@dataclass(frozen=True, kw_only=True)
class Soil:
    grip: float = 0.92
    half_slip: float = 0.75
    half_drift: float = 0.85
    wall: float = 0.8
    rolling: float = 0.055
    rolling_growth: float = 0.8
    patchiness: float = 0.08


@dataclass(frozen=True, kw_only=True)
class Rover:
    """What is wrong with a rover's sensors; angles in deg."""

    compass_bias: float = 0.5
    compass_errors: tuple[float, float, float, float] = (1.0, -0.6, 0.4, 0.3)
    compass_lag_s: float = 0.45
    compass_noise: float = 0.4
    gyro_noise_s: float = 0.15
    tilt_noise: float = 0.4
    trace_rms: float = 1.5
    trace_memory: float = 0.55
    lost_share: float = 0.03
    radius_share: float = 0.0
    """True radius of the wheels over what is thought, less one."""
    encoder_age_s: float = 0.0
    gyro_bias_sd: float = 0.1
    gyro_offset: float = 0.0
    gyro_scale: float = 0.0
    gyro_drift: float = 0.0
    """deg/s per minute."""


@dataclass(frozen=True, kw_only=True)
class Site:
    """A slope of `grade_deg` uphill along x, with mounds (x, y, height, radius)."""

    way_m: float
    grade_deg: float
    mounds: tuple[tuple[float, float, float, float], ...]

    def height_m(self, x: float, y: float) -> float:
        height = math.tan(math.radians(self.grade_deg)) * x
        for mound_x, mound_y, top, radius in self.mounds:
            square = (x - mound_x) ** 2 + (y - mound_y) ** 2
            height += top * math.exp(-0.5 * square / radius**2)
        return height


SIDEWAYS = Site(way_m=7.0, grade_deg=5.0, mounds=((6.5, 1.85, 0.68, 1.35),))
MOUNDS = Site(
    way_m=13.0,
    grade_deg=4.0,
    mounds=(
        (2.6, 0.75, 0.16, 0.60),
        (4.6, -0.7, 0.19, 0.65),
        (7.0, 0.85, 0.25, 0.75),
        (9.4, 0.8, 0.21, 0.70),
        (11.6, -0.9, 0.18, 0.70),
    ),
)


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A drive: the log as its columns, and the truth at the same times."""

    log: Columns
    truth: Columns


def draw_soil(rng: np.random.Generator) -> Soil:
    base = Soil()
    return replace(
        base,
        grip=base.grip * math.exp(0.06 * rng.standard_normal()),
        half_slip=base.half_slip * math.exp(0.10 * rng.standard_normal()),
        half_drift=base.half_drift * math.exp(0.10 * rng.standard_normal()),
        rolling=base.rolling * math.exp(0.12 * rng.standard_normal()),
    )


def draw_rover(rng: np.random.Generator) -> Rover:
    errors = 0.8 * rng.standard_normal(4)
    return Rover(
        compass_bias=1.0 * rng.standard_normal(),
        compass_errors=(errors[0], errors[1], 0.5 * errors[2], 0.5 * errors[3]),
        trace_rms=rng.uniform(1.4, 1.6),
    )


def draw_site(site: Site, rng: np.random.Generator) -> Site:
    moved = tuple(
        (
            x + 0.15 * rng.standard_normal(),
            y + 0.05 * rng.standard_normal(),
            top * rng.uniform(0.9, 1.1),
            radius,
        )
        for x, y, top, radius in site.mounds
    )
    return replace(site, grade_deg=site.grade_deg + rng.uniform(-0.4, 0.4), mounds=moved)


def random_site(rng: np.random.Generator) -> Site:
    """Return mounds anywhere: terrain for development, so that the two field tests stay unseen."""
    count = int(rng.integers(2, 6))
    places = np.sort(rng.uniform(1.5, 9.0, count))
    mounds = tuple(
        (
            float(x),
            float(rng.choice((-1, 1)) * rng.uniform(0.6, 1.0)),
            rng.uniform(0.1, 0.3),
            rng.uniform(0.5, 0.9),
        )
        for x in places
    )
    return Site(way_m=10.0, grade_deg=rng.uniform(2.0, 7.0), mounds=mounds)


def field_test(site: Site, seed: int) -> Recorded:
    """Return a drive of a site; soil and rover depend on the seed alone, so that two sites share them."""
    soil, rover = draw_soil(np.random.default_rng([seed, 1])), draw_rover(np.random.default_rng([seed, 2]))
    rng = np.random.default_rng([seed, 3, len(site.mounds)])
    return drive(draw_site(site, rng), soil, rover, rng)


class _Walk:
    """Exponentially correlated noise over distance or time, standard deviation 1."""

    def __init__(self, length: float, rng: np.random.Generator) -> None:
        self._length, self._rng = length, rng
        self.value = float(rng.standard_normal())

    def step(self, by: float) -> float:
        keep = math.exp(-by / self._length)
        self.value = keep * self.value + math.sqrt(1.0 - keep * keep) * float(self._rng.standard_normal())
        return self.value


def _tilt(site: Site, x: float, y: float, psi: float) -> tuple[float, float]:
    """Return pitch (nose up) and roll (left side up) in rad of a body on four contacts."""
    cos_psi, sin_psi = math.cos(psi), math.sin(psi)
    heights = [
        site.height_m(x + cos_psi * ahead - sin_psi * left, y + sin_psi * ahead + cos_psi * left)
        for ahead, left in CONTACTS
    ]
    rise_ahead = (heights[0] + heights[1] - heights[2] - heights[3]) / 2 / 0.60
    rise_left = (heights[0] + heights[2] - heights[1] - heights[3]) / 2 / 0.44
    pitch = math.atan(rise_ahead)
    return pitch, math.asin(math.sin(math.atan(rise_left)) * math.cos(pitch))


def _loads(pitch: float, roll: float) -> list[float]:
    """Return the share of the weight that presses on each wheel."""
    upright = math.sqrt(max(0.0, 1.0 - math.sin(pitch) ** 2 - math.sin(roll) ** 2))
    back, right = CENTRE_HEIGHT_M * math.sin(pitch), CENTRE_HEIGHT_M * math.sin(roll)
    return [
        max(0.02, upright / 4 - math.copysign(back / 0.60 / 2, ahead) - math.copysign(right / 0.44 / 2, left))
        for ahead, left in CONTACTS
    ]


def _balance(
    soil: Soil, grip: float, loads: Sequence[float], pull: tuple[float, float], guess: tuple[float, float]
) -> tuple[float, float]:
    """Return slip and sideways speed over rim speed at which the wheels carry `pull` (uphill, left)."""

    def missing(slip: float, sideways: float) -> tuple[float, float]:
        along = across = 0.0
        for load in loads:
            effort = math.hypot(slip / soil.half_slip, sideways / soil.half_drift)
            reach = grip * load / (1.0 + effort)
            along += reach * slip / soil.half_slip
            along -= soil.rolling * load * (1.0 + soil.rolling_growth * abs(slip)) * (load * 4) ** 0.15
            across -= reach * sideways / soil.half_drift + soil.wall * load * sideways * abs(sideways)
        return along - pull[0], across - pull[1]

    slip, sideways = guess
    for _ in range(30):
        f, g = missing(slip, sideways)
        fs, gs = missing(slip + 1e-6, sideways)
        fb, gb = missing(slip, sideways + 1e-6)
        a, b, c, d = (fs - f) / 1e-6, (fb - f) / 1e-6, (gs - g) / 1e-6, (gb - g) / 1e-6
        determinant = a * d - b * c
        change, turn = (d * f - b * g) / determinant, (a * g - c * f) / determinant
        slip = min(max(slip - max(-0.2, min(0.2, change)), -0.9), 0.92)
        sideways = min(max(sideways - max(-0.2, min(0.2, turn)), -0.9), 0.9)
        if abs(change) + abs(turn) < 1e-10:
            break
    return slip, sideways


def drive(
    site: Site, soil: Soil, rover: Rover, rng: np.random.Generator, *, psi_rad: float = 0.0
) -> Recorded:
    """Drive the site with equal wheel speeds, and log it."""
    x = y = turned = t = way = 0.0
    # The search begins low on hard ground, where far up the hyperbola there is no way back.
    psi, slip, sideways = psi_rad, 0.1 * min(1.0, soil.half_slip / 0.5), 0.0
    patch, sway = _Walk(0.5, rng), _Walk(0.6, rng)
    rows = []
    while way < site.way_m:
        pitch, roll = _tilt(site, x, y, psi)
        rim = 0.0 if t < REST_S else 0.1 * min(1.0, t - REST_S)
        grip = soil.grip * (1.0 + soil.patchiness * patch.step(rim * STEP_S))
        slip, sideways = _balance(
            soil, grip, _loads(pitch, roll), (math.sin(pitch), math.sin(roll)), (slip, sideways)
        )
        ahead, aside = rim * (1.0 - slip), rim * sideways
        # Nose-heavy on the side slope, uneven ground, and a driver who turns back slowly.
        rate = ahead * (0.09 * sway.step(rim * STEP_S) - 0.45 * math.sin(roll) - 0.15 * (psi - psi_rad))
        rows.append(
            (t, x, y, psi, slip, math.atan2(aside, ahead) if rim else 0.0, pitch, roll, turned, rate, ahead)
        )
        middle = psi + 0.5 * rate * STEP_S
        x += STEP_S * (math.cos(middle) * ahead - math.sin(middle) * aside)
        y += STEP_S * (math.sin(middle) * ahead + math.cos(middle) * aside)
        psi, turned, t = psi + rate * STEP_S, turned + rim / RADIUS_M * STEP_S, t + STEP_S
        way += STEP_S * math.hypot(ahead, aside)
    truth = dict(zip(TRUTH, np.array(rows).T, strict=True))
    return Recorded(log=_measure(truth, rover, rng), truth=truth)


def _measure(truth: Columns, rover: Rover, rng: np.random.Generator) -> Columns:
    count = len(truth["t_s"])
    enc = {
        f"position{i}_rad": np.round(
            (truth["turned"] * (1.0 + 0.002 * rng.standard_normal()) / (1.0 + rover.radius_share)) / 1e-3
        )
        * 1e-3
        for i in (1, 2, 3, 4)
    }
    if rover.encoder_age_s > 0.0:
        late = max(1, round(rover.encoder_age_s / STEP_S))
        enc = {name: np.concatenate((np.full(late, one[0]), one[:-late])) for name, one in enc.items()}
    bias_deg_s = (
        rover.gyro_bias_sd * rng.standard_normal()
        + rover.gyro_offset
        + rover.gyro_drift * truth["t_s"] / 60.0
    )
    log = {
        "t_s": truth["t_s"],
        **enc,
        "heading_deg": _compass_deg(truth["yaw_rad"], rover, rng),
        "yaw_rate_deg_s": (1.0 + rover.gyro_scale) * np.degrees(truth["rate"])
        + bias_deg_s
        + rover.gyro_noise_s * rng.standard_normal(count),
        "pitch_deg": np.degrees(truth["pitch_rad"]) + rover.tilt_noise * rng.standard_normal(count),
        "roll_deg": np.degrees(truth["roll_rad"]) + rover.tilt_noise * rng.standard_normal(count),
    }
    return log | _trace(truth, rover, rng)


def _compass_deg(psi: Array, rover: Rover, rng: np.random.Generator) -> Array:
    lagged, now, shown = psi[0], 0.0, []
    keep = math.exp(-STEP_S / rover.compass_lag_s)
    for step, heading in enumerate(psi):
        lagged = keep * lagged + (1.0 - keep) * heading
        if step % COMPASS_STEPS == 0:
            waves = (math.sin(lagged), math.cos(lagged), math.sin(2 * lagged), math.cos(2 * lagged))
            error = sum(size * wave for size, wave in zip(rover.compass_errors, waves, strict=True))
            now = (
                math.degrees(lagged)
                + rover.compass_bias
                + error
                + rover.compass_noise * rng.standard_normal()
            )
        shown.append(round(now, 1))
    return np.array(shown)


def _trace(truth: Columns, rover: Rover, rng: np.random.Generator) -> Columns:
    """Return the angle of the rear left wheel's velocity as the camera reports it."""
    _, _, (back, left), _ = CONTACTS
    aside = truth["ahead"] * np.tan(truth["slip_angle_rad"]) + truth["rate"] * back
    exact = np.degrees(np.arctan2(aside, np.maximum(truth["ahead"] - truth["rate"] * left, 1e-9)))
    noise, missing = _Walk(1.0, rng), 0
    held, angle, valid, new = 0.0, [], [], []
    for step, value in enumerate(exact):
        if step % TRACE_STEPS == 0:
            error = rover.trace_rms * noise.step(-math.log(rover.trace_memory))
            if missing == 0 and rng.random() < rover.lost_share / 2:
                missing = int(rng.integers(1, 4))
            seen = missing == 0 and truth["turned"][step] > 2.0
            held = round(value + error, 2) if seen else held
            missing = max(0, missing - 1)
        angle.append(held)
        valid.append(float(seen))
        new.append(float(step % TRACE_STEPS == 0))
    return {"beta_ftrace_deg": np.array(angle), "beta_valid": np.array(valid), "beta_new": np.array(new)}
