"""How the rover really moves in a prepared drive, and where its wheels touch the ground."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_backends.rear_scene.ground_map import Terrain
from sim_backends.rear_scene.rig import Rig
from sim_backends.rear_scene.scene import Pose, rocking, rotations

Floats: TypeAlias = NDArray[np.float64]

RATE_HZ = 100
STEP_S = 1 / RATE_HZ
REACTION_M = 0.12
"""Way over which slip and drift follow a change of the ground."""
LARGEST_SLIP = 0.8


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is commanded and what disturbs it, one value per step of 1 / `RATE_HZ` s.

    Attributes:
        rim_speed_m_s: Wheel radius times wheel speed.
        slip: Longitudinal slip ratio on level ground.
        slip_angle_rad: Drift of the origin against the heading on level ground.
        yaw_rate_rad_s: Of the vehicle.
        rock_rad: Lean of the body against the contact plane, about x and about y, shape (n, 2).
        drift_per_roll: Drift angle that a roll angle adds, rad per rad; downhill.
        slip_per_pitch: Slip ratio that a rise adds, per rad.
        slip_per_drift: Slip ratio that a drift angle adds, per rad.
        hard_m: Where the ground takes no rut: rows of first and last way driven by the watched wheel, m.
        start_m: Start x, y.
        start_yaw_rad: Heading at the start.
    """

    rim_speed_m_s: Floats
    slip: Floats
    slip_angle_rad: Floats
    yaw_rate_rad_s: Floats
    rock_rad: Floats
    drift_per_roll: float = 0.0
    slip_per_pitch: float = 0.0
    slip_per_drift: float = 0.0
    hard_m: tuple[tuple[float, float], ...] = ()
    start_m: tuple[float, float] = (0.0, 0.0)
    start_yaw_rad: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Motion:
    """The drive, one row per step; angles in rad, m, world frame unless named otherwise.

    Attributes:
        contact_m: Where the watched wheel's lowest point stands, shape (n, 3).
        contact_velocity_m_s: Its velocity in the vehicle frame, x and y, shape (n, 2).
        velocity_m_s: Of the origin in the vehicle frame, shape (n, 2).
        softness: Of the ground under each wheel, in the order of `Rig.wheels`, shape (n, wheels).
        body_rate_rad_s: What a gyro fixed to the body feels about x, y, z.
    """

    t_s: Floats
    position_m: Floats
    vehicle_to_world: Floats
    yaw_rad: Floats
    pitch_rad: Floats
    roll_rad: Floats
    rock_rad: Floats
    wheel_angle_rad: Floats
    rim_speed_m_s: Floats
    slip: Floats
    slip_angle_rad: Floats
    yaw_rate_rad_s: Floats
    softness: Floats
    contact_m: Floats
    contact_velocity_m_s: Floats
    velocity_m_s: Floats
    body_rate_rad_s: Floats

    def pose(self, step: int) -> Pose:
        """Return the pose at a step."""
        return Pose(
            position_m=self.position_m[step],
            vehicle_to_world=self.vehicle_to_world[step],
            rock_rad=(float(self.rock_rad[step, 0]), float(self.rock_rad[step, 1])),
            yaw_rad=float(self.yaw_rad[step]),
            wheel_angle_rad=float(self.wheel_angle_rad[step]),
            velocity_m_s=(float(self.velocity_m_s[step, 0]), float(self.velocity_m_s[step, 1])),
            yaw_rate_rad_s=float(self.yaw_rate_rad_s[step]),
            softness=tuple(self.softness[step].tolist()),
            steering_rad=(0.0,) * self.softness.shape[1],
        )


@dataclass(frozen=True)
class _Track:
    """Path on the map: x, y, yaw, slip ratio and slip angle per step."""

    x_m: Floats
    y_m: Floats
    yaw_rad: Floats
    slip: Floats
    slip_angle_rad: Floats


class _ContactPlane:
    """How the rover stands on the terrain: the plane that fits the ground under its wheels best."""

    def __init__(self, rig: Rig, terrain: Terrain) -> None:
        self._terrain = terrain
        self._wheels = np.array([[wheel.x_m, wheel.y_m] for wheel in rig.wheels])
        self._fit = np.linalg.pinv(np.insert(self._wheels, 2, 1.0, axis=1))

    def plane(self, x_m: Floats, y_m: Floats, yaw_rad: Floats) -> Floats:
        """Return rise ahead, rise to the left (m per m) and height of the origin, rows of three."""
        cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
        ahead, left = self._wheels[:, :1], self._wheels[:, 1:]
        heights = self._terrain.height_m(
            x_m + cosine * ahead - sine * left, y_m + sine * ahead + cosine * left
        )
        return np.asarray(self._fit @ heights)


def drive(rig: Rig, terrain: Terrain, plan: Plan, depth_m: float) -> Motion:
    """Drive the plan over the terrain; ruts are `depth_m` deep where the ground is soft."""
    contact_plane = _ContactPlane(rig, terrain)
    track = _integrate(contact_plane, plan)
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(track.x_m), np.diff(track.y_m)))])
    ahead = [wheel.x_m - rig.wheel.x_m for wheel in rig.wheels]
    softness = np.stack([_softness(way_m + x_m, plan.hard_m) for x_m in ahead], axis=1)
    rise_ahead, rise_left, z_m = contact_plane.plane(track.x_m, track.y_m, track.yaw_rad)
    pitch, roll = -np.arctan(rise_ahead), np.arctan(rise_left / np.hypot(1.0, rise_ahead))
    turn = rotations(track.yaw_rad, pitch, roll)
    position = np.stack([track.x_m, track.y_m, z_m - depth_m * softness[:, -1]], axis=1)
    foot = np.array([rig.wheel.x_m, rig.wheel.y_m, 0.0])
    contact = position + turn @ foot
    body = turn @ np.stack([rocking(roll, pitch) for roll, pitch in plan.rock_rad])
    return Motion(
        t_s=STEP_S * np.arange(len(way_m), dtype=np.float64),
        position_m=position,
        vehicle_to_world=turn,
        yaw_rad=track.yaw_rad,
        pitch_rad=pitch,
        roll_rad=roll,
        rock_rad=plan.rock_rad,
        wheel_angle_rad=np.cumsum(plan.rim_speed_m_s) * STEP_S / rig.wheel.radius_m,
        rim_speed_m_s=plan.rim_speed_m_s,
        slip=track.slip,
        slip_angle_rad=track.slip_angle_rad,
        yaw_rate_rad_s=plan.yaw_rate_rad_s,
        softness=softness,
        contact_m=contact,
        contact_velocity_m_s=_in_vehicle(turn, contact),
        velocity_m_s=_in_vehicle(turn, position),
        body_rate_rad_s=_body_rates(body),
    )


def _integrate(contact_plane: _ContactPlane, plan: Plan) -> _Track:
    steps = len(plan.rim_speed_m_s)
    x_m, y_m, yaw = (np.zeros(steps) for _ in range(3))
    slip, drift = plan.slip.copy(), plan.slip_angle_rad.copy()
    x_m[0], y_m[0] = plan.start_m
    yaw[0] = plan.start_yaw_rad
    added_slip = added_drift = 0.0
    for k in range(steps):
        if plan.drift_per_roll or plan.slip_per_pitch:
            rise_ahead, rise_left, _ = contact_plane.plane(x_m[k], y_m[k], yaw[k])[:, 0]
            follow = 1 - math.exp(-plan.rim_speed_m_s[k] * STEP_S / REACTION_M)
            added_drift += follow * (-plan.drift_per_roll * math.atan(rise_left) - added_drift)
            wanted = plan.slip_per_pitch * math.atan(rise_ahead) + plan.slip_per_drift * abs(drift[k])
            added_slip += follow * (wanted - added_slip)
        drift[k] += added_drift
        slip[k] = min(max(slip[k] + added_slip, -0.2), LARGEST_SLIP)
        if k + 1 < steps:
            forward = plan.rim_speed_m_s[k] * (1 - slip[k])
            left = forward * math.tan(drift[k])
            middle = yaw[k] + 0.5 * plan.yaw_rate_rad_s[k] * STEP_S
            x_m[k + 1] = x_m[k] + STEP_S * (forward * math.cos(middle) - left * math.sin(middle))
            y_m[k + 1] = y_m[k] + STEP_S * (forward * math.sin(middle) + left * math.cos(middle))
            yaw[k + 1] = yaw[k] + plan.yaw_rate_rad_s[k] * STEP_S
    return _Track(x_m, y_m, yaw, slip, drift)


def _softness(way_m: Floats, hard_m: tuple[tuple[float, float], ...]) -> Floats:
    softness = np.ones_like(way_m)
    for first, last in hard_m:
        edge = np.minimum(way_m - first, last - way_m)
        softness *= np.clip(0.5 - edge / 0.03, 0.0, 1.0)
    return softness


def _in_vehicle(turn: Floats, points: Floats) -> Floats:
    velocity = np.gradient(points, STEP_S, axis=0)
    return np.asarray(np.einsum("nij,ni->nj", turn, velocity)[:, :2])


def _body_rates(body: Floats) -> Floats:
    """Return the angular velocity in the body frame of a series of rotations body to world."""
    spin = np.einsum("nji,njk->nik", body, np.gradient(body, STEP_S, axis=0))
    return np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
