"""Effects that may be missing in the odometry of a four-wheel rover; their cards are in tables.toml."""

import numpy as np
from scipy.signal import lfilter

from sim_backends.models.drive_effects import MOST_SLIP
from sim_backends.models.interface import Array, Values


def iron_deg(values: Values, heading_rad: Array, waves: float) -> Array:
    """Return the error of the compass by `hard_iron`, one wave per turn, or by `soft_iron`, two."""
    error: Array = values["size"] * np.cos(waves * (heading_rad - np.radians(values["phase"])))
    return error


def lagging_heading(values: Values, t_s: Array, heading_rad: Array) -> Array:
    """Return what a compass damped by `compass_lag` shows of a heading."""
    if values["time"] <= 0.0:
        return heading_rad
    keep = float(np.exp(-(t_s[1] - t_s[0]) / values["time"]))
    shown: Array = lfilter([1.0 - keep], [1.0, -keep], heading_rad, zi=keep * heading_rad[:1])[0]
    return shown


def slip_on_soil(level: Values, hill: Values, climb_rad: Array, rim_m_s: Array) -> Array:
    """Return the slip by `wheel_slip` and `slope_slip`."""
    steepening = 1.0 + hill["curvature"] * np.abs(climb_rad)
    slip = level["share"] + hill["per_slope"] * climb_rad * steepening * np.sign(rim_m_s)
    return np.clip(slip, -MOST_SLIP, MOST_SLIP)


def drift_angle(values: Values, roll_rad: Array) -> Array:
    """Return the angle of the motion to the left of the rover by `side_drift`, rad."""
    return np.clip(-values["per_roll"] * roll_rad, -1.5, 1.5)
