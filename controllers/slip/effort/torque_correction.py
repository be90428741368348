"""The paper's torque correction: raise the setpoints where the wheels work without moving the rover."""

import math
from collections.abc import Sequence

import numpy as np

from controllers.matrices import inverse, product
from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.slip.effort.settings import TorqueCorrectionSettings


class TorqueCorrection:
    """Finds the part of the wheels' force that does not act along the commanded motion.

    Force on the body is F = J^T tau / R. F', its part across the commanded twist, comes from
    uneven ground; tau_c = R J^-T F' is the wheels' share in it, and each setpoint is changed by
    gain * tau_c. Forces and twists are compared with the moment divided, the yaw rate multiplied, by the
    base radius.

    Source: paper 003, torque correction; its matrix is replaced by the inverse of its own force transform.

    Args:
        rover: Geometry of the wheels.
        settings: Gain and bound.
    """

    def __init__(self, rover: OmniRoverSettings, settings: TorqueCorrectionSettings) -> None:
        radius_m, base_m = rover.wheel_radius_m, rover.base_radius_m
        angles_rad = [math.radians(angle) for angle in rover.wheel_angles_deg]
        jacobian = np.array([[-math.sin(angle), math.cos(angle), base_m] for angle in angles_rad])
        self._scale = np.array([1.0, 1.0, base_m])
        self._to_force = jacobian.T / radius_m
        self._to_torque = radius_m * inverse(jacobian.T)
        self._settings = settings

    def set_point_changes(
        self, wheel_torque_nm: Sequence[float], commanded_twist: Sequence[float]
    ) -> tuple[float, ...]:
        """Return what to add to each setpoint, rad/s, within the bound.

        Args:
            wheel_torque_nm: Torque at each wheel, positive where it pushes counter-clockwise.
            commanded_twist: Commanded velocity x, y in m/s and yaw rate in rad/s; at rest nothing is added.
        """
        force = product(self._to_force, np.asarray(wheel_torque_nm)) / self._scale
        twist = np.asarray(commanded_twist) * self._scale
        size = math.hypot(*twist.tolist())
        if size == 0.0:
            return (0.0,) * len(self._to_torque)
        along = twist / size
        across = (force - float((force * along).sum()) * along) * self._scale
        bound = self._settings.bound_rad_s
        changes = self._settings.gain_rad_s_nm * product(self._to_torque, across)
        return tuple(np.clip(changes, -bound, bound).tolist())
