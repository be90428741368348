"""How a vehicle moves, what its wheels do meanwhile, and what its sensors say about it."""

from dataclasses import dataclass

import numpy as np

from tests.nature.ambiguous_ground.camera import WHEEL_CONTACT
from tests.nature.ambiguous_ground.picture import Numbers


@dataclass(frozen=True)
class Pose:
    """Place of the vehicle's origin in the world, m, and its heading, rad, counter-clockwise."""

    x: float
    y: float
    psi: float


@dataclass(frozen=True)
class Motion:
    """A drive. Entry i of every array belongs to frame i; steps lead from frame i - 1 to frame i.

    Attributes:
        fps: frames per second.
        wheel: distance that the rim of the watched wheel turns in a step, m.
        slip: 1 - (distance of the watched wheel over the ground, along it) / `wheel`, in a step.
        theta: direction of the watched wheel's velocity from its own axis, rad; 0 where it stands.
        turn: change of heading in a step, rad.
        x: place of the vehicle's origin, m.
        y: the same, to the left.
        psi: heading, rad.
        beta: direction of the velocity of the vehicle's origin from its axis, rad.
    """

    fps: float
    wheel: Numbers
    slip: Numbers
    theta: Numbers
    turn: Numbers
    x: Numbers
    y: Numbers
    psi: Numbers
    beta: Numbers

    @property
    def travel(self) -> Numbers:
        """Distance of the watched wheel over the ground in each step, m."""
        distance: Numbers = self.wheel * (1.0 - self.slip)
        return distance

    def pose(self, frame: float) -> Pose:
        """The pose at any time, given in frames; the first and the last step go on beyond the drive."""
        i = min(max(int(np.floor(frame)), 0), len(self.x) - 2)
        x, y, psi = (float(a[i] + (frame - i) * (a[i + 1] - a[i])) for a in (self.x, self.y, self.psi))
        return Pose(x, y, psi)


def integrate(
    fps: float, wheel: Numbers, slip: Numbers, theta: Numbers, turn: Numbers, heading: float
) -> Motion:
    """The drive that follows from what the watched wheel does in every step."""
    along = wheel * (1.0 - slip)
    forward = along + turn * WHEEL_CONTACT[1]
    left = along * np.tan(theta) - turn * WHEEL_CONTACT[0]
    turned = turn.copy()
    turned[0] = 0.0
    psi = heading + np.cumsum(turned)
    middle = psi - 0.5 * turned
    steps_x = np.cos(middle) * forward - np.sin(middle) * left
    steps_y = np.sin(middle) * forward + np.cos(middle) * left
    steps_x[0] = steps_y[0] = 0.0
    moves = along > 0.0
    beta, theta = np.where(moves, np.arctan2(left, forward), 0.0), np.where(moves, theta, 0.0)
    return Motion(fps, wheel, slip, theta, turn, np.cumsum(steps_x), np.cumsum(steps_y), psi, beta)


def truth_rows(motion: Motion) -> list[str]:
    """Lines of truth.csv. No drive has a trace, so its columns describe the velocity alone."""
    rows = ["frame,t,present,visible_len_m,theta_t_deg,d_t_m,theta_chord_deg,beta_deg,slip,x,y,psi_deg"]
    for i in range(len(motion.x)):
        theta = motion.theta[i]
        beside = WHEEL_CONTACT[1] * np.cos(theta) - WHEEL_CONTACT[0] * np.sin(theta)
        angle = round(float(np.degrees(theta)), 4)
        numbers = [
            round(i / motion.fps, 6), 0, 0.0, angle, round(float(beside), 5), angle,
            round(float(np.degrees(motion.beta[i])), 4), round(float(motion.slip[i]), 5),
            round(float(motion.x[i]), 6), round(float(motion.y[i]), 6),
            round(float(np.degrees(motion.psi[i])), 4),
        ]  # fmt: skip
        rows.append(",".join([str(i), *map(str, numbers)]))
    return rows


def telemetry_rows(motion: Motion, rng: np.random.Generator, *, of_rover: bool = False) -> list[str]:
    """Lines of telemetry.csv: the wheel's mean speed since the previous frame, and the turn rates.

    Args:
        motion: the drive.
        rng: noise of the sensors.
        of_rover: whether the speed is that of the vehicle's origin by its wheels, instead of the watched one.
    """
    rows = ["frame,t,wheel_speed_mps,compass_deg,gyro_roll_dps,gyro_pitch_dps,gyro_yaw_dps"]
    bias = rng.normal(0.0, 0.12, 3)
    north = rng.normal(0.0, 1.0)
    rolled = motion.wheel + (motion.turn * WHEEL_CONTACT[1] if of_rover else 0.0)
    for i in range(len(motion.x)):
        speed = rolled[i] * motion.fps * (1.0 + 0.003 * rng.standard_normal())
        compass = np.degrees(motion.psi[i]) + north + 0.3 * rng.standard_normal()
        rates = bias + 0.12 * rng.standard_normal(3)
        rates[2] += np.degrees(motion.turn[i]) * motion.fps
        cells = [f"{i / motion.fps:.6g}", f"{speed:.5f}", f"{compass:.3f}", *(f"{r:.4f}" for r in rates)]
        rows.append(",".join([str(i), *cells]))
    return rows
