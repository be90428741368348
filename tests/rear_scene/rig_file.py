"""A rig of the rear scene with everything that a rig file holds."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sim_backends.rear_scene.rig import Rig, Wheel

Floats: TypeAlias = NDArray[np.float64]

RIG_SCHEMA = "rear-camera-rig/1"
VEHICLE_FRAME = (
    "origin = projection of the centre of mass G on the wheel-contact plane, X forward, Y left, Z up; "
    "angles counter-clockwise positive"
)


@dataclass(frozen=True, kw_only=True)
class CalibratedRig(Rig):
    """A rig as a user would calibrate and describe it.

    Attributes:
        b_m: From the rear axle to the centre of mass.
        nominal_speed_m_s: Usual speed of the rover.
        behind_contact_m: Length of ground in view behind the contact.
        lateral_about_contact_m: Width of ground in view about the contact.
        max_slip_angle_deg: Largest slip angle to search for.
    """

    b_m: float
    nominal_speed_m_s: float = 0.08
    behind_contact_m: float = 0.6
    lateral_about_contact_m: float = 0.8
    max_slip_angle_deg: float = 35.0

    def sees(self, pixels: Floats) -> NDArray[np.bool_]:
        """Return which of these (column, row) lie in the picture; NaN does not."""
        column, row = pixels[:, 0], pixels[:, 1]
        return (column >= 0) & (column <= self.width - 1) & (row >= 0) & (row <= self.height - 1)

    def as_json(self) -> dict[str, object]:
        """Return what a rig file of schema `rear-camera-rig/1` holds."""
        return {
            "schema": RIG_SCHEMA,
            "vehicle_frame": VEHICLE_FRAME,
            "image": {"width": self.width, "height": self.height, "fps": self.fps, "format": "bgr8"},
            "camera_matrix": [list(map(float, row)) for row in self.camera_matrix],
            "dist_coeffs": {"model": "opencv", "values": list(map(float, self.distortion))},
            "R_vehicle_camera": [list(map(float, row)) for row in self.vehicle_from_camera],
            "t_vehicle_camera": list(map(float, self.camera_m)),
            "wheel": _wheel_json(self.wheel),
            "other_wheels": [_wheel_json(wheel) for wheel in self.other_wheels],
            "b_m": self.b_m,
            "nominal_speed_mps": self.nominal_speed_m_s,
            "ground_view_m": {
                "behind_contact": self.behind_contact_m,
                "lateral_about_contact": self.lateral_about_contact_m,
            },
            "max_slip_angle_deg": self.max_slip_angle_deg,
        }


def _wheel_json(wheel: Wheel) -> dict[str, object]:
    return {
        "name": wheel.name,
        "contact_point": [wheel.x_m, wheel.y_m, 0.0],
        "radius_m": wheel.radius_m,
        "width_m": wheel.width_m,
        "grouser_height_m": wheel.grouser_height_m,
        "lug_count": wheel.lug_count,
        "steer_deg": wheel.steer_deg,
    }
