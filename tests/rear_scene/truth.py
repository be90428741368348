"""What is exactly true of a frame, and what the rover's other sensors say at that time."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_backends.rear_scene.scene import rocking
from tests.rear_scene.motion import RATE_HZ, STEP_S, Motion
from tests.rear_scene.rig_file import CalibratedRig

Floats: TypeAlias = NDArray[np.float64]

POINT_STEP_M = 0.004
LONGEST_TRACE_M = 2.0
PRESENT_M = 0.20
"""A trace is present in a frame that shows at least this length of it."""
SOFT_ENOUGH = 0.5


@dataclass(frozen=True, kw_only=True)
class FrameTruth:
    """Truth of one frame; angles counter-clockwise positive, in the vehicle frame unless named otherwise.

    Attributes:
        frame: Index of the frame.
        t: Time of the middle of the exposure, s.
        x_m, y_m: Origin of the vehicle frame in the world; `yaw_deg`, `pitch_deg` (nose down positive),
            `roll_deg` (left side up positive) of the wheel-contact plane.
        rock_roll_deg, rock_pitch_deg: How far the body, with camera and gyro, leans against that plane.
        slip: Longitudinal slip ratio of the wheels.
        slip_angle_deg: Direction of the origin's velocity.
        theta_t_deg: Direction of the watched wheel's velocity against that wheel's heading.
        d_t_m: Distance of the line through the contact in that direction from the origin; positive when
            the line passes on the left.
        chord_deg: Direction from the farthest to the nearest visible point of the trace's centre line;
            NaN without a trace. `chord_d_m` is that line's distance from the origin.
        line_deg: Direction of the straight line that fits the visible centre line best.
        visible_m: Length of centre line in the picture.
        trace_present: Whether that is at least 0.20 m, and the frame usable.
        usable: False for a frame that is black or burnt out.
    """

    frame: int
    t: float
    x_m: float
    y_m: float
    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    rock_roll_deg: float
    rock_pitch_deg: float
    slip: float
    slip_angle_deg: float
    yaw_rate_dps: float
    theta_t_deg: float
    d_t_m: float
    chord_deg: float
    chord_d_m: float
    line_deg: float
    visible_m: float
    trace_present: bool
    usable: bool


@dataclass(frozen=True, kw_only=True)
class Telemetry:
    """What the other sensors say; the columns of a telemetry file.

    Attributes:
        wheel_speed_mps: Wheel radius times wheel speed: the rim, not the ground.
        compass_deg: Heading, counter-clockwise from the world's x.
        gyro_roll_dps: About x forward, averaged over the 50 ms up to the frame; the others about y, z.
    """

    frame: int
    t: float
    wheel_speed_mps: float
    compass_deg: float
    gyro_roll_dps: float
    gyro_pitch_dps: float
    gyro_yaw_dps: float


@dataclass(frozen=True, kw_only=True)
class SensorErrors:
    """How the other sensors err.

    Attributes:
        gyro_bias_dps: About x, y, z.
        compass_bias_deg: Constant; `compass_swing_deg` times the sine of heading plus `compass_phase_rad`.
        compass_lag_s: Time constant.
        wheel_speed_scale: Relative error of the assumed radius.
    """

    gyro_bias_dps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro_noise_dps: float = 0.1
    compass_bias_deg: float = 0.0
    compass_swing_deg: float = 0.0
    compass_phase_rad: float = 0.0
    compass_lag_s: float = 0.45
    compass_noise_deg: float = 0.5
    wheel_speed_scale: float = 0.0
    wheel_speed_noise_mps: float = 0.001


def centre_line(rig: CalibratedRig, motion: Motion, step: int) -> tuple[Floats, Floats]:
    """Return the trace's centre line as it is at a step: points of the vehicle frame (n, 3), their pixels.

    It starts at the contact and goes back in time; points that left no rut are NaN.
    """
    way = np.linalg.norm(np.diff(motion.contact_m[: step + 1], axis=0), axis=1)
    behind = np.concatenate([np.cumsum(way[::-1])[::-1], [0.0]])
    marks = np.floor(behind / POINT_STEP_M)
    picked = np.flatnonzero(np.diff(marks, prepend=marks[0] + 1) != 0)
    picked = picked[behind[picked] < LONGEST_TRACE_M][::-1]
    turn = motion.vehicle_to_world[step]
    points = (motion.contact_m[picked] - motion.position_m[step]) @ turn
    points[motion.softness[picked, -1] < SOFT_ENOUGH] = np.nan
    rock = rocking(*motion.rock_rad[step])
    return points, rig.project(points @ rock)


def frame_truth(rig: CalibratedRig, motion: Motion, step: int, frame: int, usable: bool) -> FrameTruth:
    """Return the truth at a step of the motion."""
    points, pixels = centre_line(rig, motion, step)
    seen = rig.sees(pixels) & ~_behind_wheel(rig, motion, step, pixels)
    line = points[seen, :2]
    gaps = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    visible_m = float(gaps[seen[1:] & seen[:-1]].sum())
    chord = _direction(line[0] - line[-1]) if visible_m > 0 else math.nan
    chord_d = _distance(line[0], chord) if visible_m > 0 else math.nan
    theta = math.atan2(motion.contact_velocity_m_s[step, 1], motion.contact_velocity_m_s[step, 0])
    rock_roll, rock_pitch = np.degrees(motion.rock_rad[step])
    return FrameTruth(
        frame=frame,
        t=float(motion.t_s[step]),
        x_m=float(motion.position_m[step, 0]),
        y_m=float(motion.position_m[step, 1]),
        yaw_deg=math.degrees(motion.yaw_rad[step]),
        pitch_deg=math.degrees(motion.pitch_rad[step]),
        roll_deg=math.degrees(motion.roll_rad[step]),
        rock_roll_deg=float(rock_roll),
        rock_pitch_deg=float(rock_pitch),
        slip=float(motion.slip[step]),
        slip_angle_deg=math.degrees(math.atan2(motion.velocity_m_s[step, 1], motion.velocity_m_s[step, 0])),
        yaw_rate_dps=math.degrees(motion.yaw_rate_rad_s[step]),
        theta_t_deg=math.degrees(theta) - rig.wheel.steer_deg,
        d_t_m=_distance(np.array([rig.wheel.x_m, rig.wheel.y_m]), theta),
        chord_deg=math.degrees(chord),
        chord_d_m=chord_d,
        line_deg=math.degrees(_best_line(line)) if visible_m > 0 else math.nan,
        visible_m=visible_m,
        trace_present=usable and visible_m >= PRESENT_M,
        usable=usable,
    )


def telemetry(
    motion: Motion, steps: list[int], errors: SensorErrors, rng: np.random.Generator
) -> list[Telemetry]:
    """Return what the sensors say at the steps of the motion."""
    window = RATE_HZ // 20
    kept = math.exp(-STEP_S / errors.compass_lag_s) if errors.compass_lag_s > 0 else 0.0
    lagged = motion.yaw_rad.copy()
    for k in range(1, len(lagged)):
        lagged[k] = kept * lagged[k - 1] + (1 - kept) * motion.yaw_rad[k]
    rows = []
    for frame, step in enumerate(steps):
        rates = np.degrees(motion.body_rate_rad_s[max(0, step - window) : step + 1].mean(axis=0))
        gyro = rates + errors.gyro_bias_dps + errors.gyro_noise_dps * rng.standard_normal(3)
        swing = errors.compass_swing_deg * math.sin(lagged[step] + errors.compass_phase_rad)
        compass = math.degrees(lagged[step]) + errors.compass_bias_deg + swing
        compass += errors.compass_noise_deg * rng.standard_normal()
        speed = motion.rim_speed_m_s[step] * (1 + errors.wheel_speed_scale)
        rows.append(
            Telemetry(
                frame=frame,
                t=float(motion.t_s[step]),
                wheel_speed_mps=float(speed + errors.wheel_speed_noise_mps * rng.standard_normal()),
                compass_deg=float(compass % 360),
                gyro_roll_dps=float(gyro[0]),
                gyro_pitch_dps=float(gyro[1]),
                gyro_yaw_dps=float(gyro[2]),
            )
        )
    return rows


def _behind_wheel(rig: CalibratedRig, motion: Motion, step: int, pixels: Floats) -> NDArray[np.bool_]:
    outline = rig.wheel_outline(rocking(*motion.rock_rad[step]))
    if outline is None:
        return np.zeros(len(pixels), np.bool_)
    sides = np.roll(outline, -1, axis=0) - outline
    from_corners = pixels[:, None, :] - outline
    turns = sides[:, 0] * from_corners[..., 1] - sides[:, 1] * from_corners[..., 0]
    return np.asarray((turns >= 0).all(axis=1) | (turns <= 0).all(axis=1))


def _direction(vector: Floats) -> float:
    return math.atan2(vector[1], vector[0])


def _distance(point: Floats, direction: float) -> float:
    return float(point[1] * math.cos(direction) - point[0] * math.sin(direction))


def _best_line(points: Floats) -> float:
    spread = np.cov((points - points.mean(axis=0)).T)
    along = np.linalg.eigh(spread)[1][:, -1]
    return _direction(along if along @ (points[0] - points[-1]) > 0 else -along)
