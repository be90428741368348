"""The calibration of a camera that sees ground, and the wheel it watches: schema `rear-camera-rig/1`."""

from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    ValidationError,
    field_validator,
    model_validator,
)

from drivers.settings import Settings

SCHEMA = "rear-camera-rig/1"
LARGEST_ROVER_M = 10.0
OTHER_MODELS = ("fish", "kannala", "equidistant", "rational", "omni", "scaramuzza")

LEAST_LOOK_DOWN = 0.05
"""Least downward part of a ray's direction; flatter rays meet the ground metres away."""
COARSEST = 8.0
VIEW_RAYS = 41
"""Rays to either side, to find the ground in view."""
VIEW_PERCENTILES = (5.0, 95.0)
"""Of the rays, for the width of the ground to use: its corners are seen by few."""

Floats = NDArray[np.float64]
Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]
Coordinate = Annotated[float, Field(ge=-LARGEST_ROVER_M, le=LARGEST_ROVER_M)]
Positive = Annotated[float, Field(gt=0)]
Pixels = Annotated[int, Field(ge=64, le=8192)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RigGeometry:
    """Calibrated camera, the ground to use, and the wheel whose trace it sees.

    Without a wheel the contact is the front end of the ground to use, and the wheel has no width.

    Attributes:
        width: Image width in pixels.
        height: Image height in pixels.
        camera_matrix: 3 x 3 intrinsic matrix in pixels (OpenCV).
        distortion: k1 k2 p1 p2 k3 (OpenCV).
        rotation: 3 x 3, turns camera coordinates (x right, y down, z ahead) into vehicle coordinates.
        position_m: Camera in the vehicle frame.
        contact_m: Contact point of the wheel in the vehicle frame.
        wheel_width_m: Width of the wheel.
        wheel_radius_m: Radius of the wheel, grousers included.
        lead_m: From that contact to the one of the next wheel ahead in about the same track, in the vehicle
            frame: forward, left; None without one.
        steer_rad: Angle of the wheel's longitudinal axis from x, counter-clockwise.
        behind_m: Length of ground to use, from the contact backwards.
        lateral_m: Ground to use to either side of the contact.
        max_slip_rad: Largest angle of a trace from the wheel's axis, below 60 deg.
        nominal_speed_m_s: Speed assumed where none is measured.
    """

    width: int
    height: int
    camera_matrix: Floats
    distortion: Floats
    rotation: Floats
    position_m: Floats
    contact_m: Floats
    wheel_width_m: float
    wheel_radius_m: float
    lead_m: tuple[float, float] | None
    steer_rad: float
    behind_m: float
    lateral_m: float
    max_slip_rad: float
    nominal_speed_m_s: float

    @property
    def watches_wheel(self) -> bool:
        """Return whether the rig is of a camera that watches a wheel."""
        return self.wheel_width_m > 0

    @property
    def point_m(self) -> tuple[float, float]:
        """Return the point whose motion is measured, forward and left: the contact, else the origin."""
        return (float(self.contact_m[0]), float(self.contact_m[1])) if self.watches_wheel else (0.0, 0.0)


class ImageFormat(Settings):
    """Frames of the camera.

    Attributes:
        width: Width in pixels.
        height: Height in pixels.
        fps: Frames per second.
        format: Pixel format; for information.
    """

    width: Pixels
    height: Pixels
    fps: Positive
    format: str


class Distortion(Settings):
    """Lens distortion.

    Attributes:
        model: Name of the model; only OpenCV's plain one, k1 k2 p1 p2 k3, is known.
        values: k1 k2 p1 p2 k3.
    """

    model: str
    values: tuple[float, float, float, float, float]

    @field_validator("model")
    @classmethod
    def _is_plain(cls, name: str) -> str:
        if any(other in name.lower() for other in OTHER_MODELS):
            raise ValueError("only OpenCV's plain model, k1 k2 p1 p2 k3, is known: calibrate with it")
        return name


class Wheel(Settings):
    """The observed wheel.

    Attributes:
        name: Name of the wheel; for information.
        contact_point: Where it touches the ground, x y z in m in the vehicle frame.
        radius_m: Radius without grousers.
        width_m: Width of the wheel.
        grouser_height_m: Height of the grousers.
        lug_count: Number of grousers.
        steer_deg: Angle of the wheel's longitudinal axis from x, counter-clockwise.
    """

    name: str
    contact_point: Triple
    radius_m: Positive
    width_m: Annotated[float, Field(ge=0.02, le=1.0)]
    grouser_height_m: Annotated[float, Field(ge=0)]
    lug_count: Annotated[int, Field(ge=0)]
    steer_deg: Annotated[float, Field(ge=-90, le=90)]


class OtherWheel(BaseModel):
    """The part of another wheel's entry that is used: where it touches the ground, x y z in m."""

    model_config = ConfigDict(extra="ignore", strict=True, allow_inf_nan=False)

    contact_point: Annotated[list[Coordinate], Field(min_length=3, max_length=3)]


class GroundView(Settings):
    """Ground that the camera sees.

    Attributes:
        behind_contact: Length behind the contact, in m.
        lateral_about_contact: Width to either side of the contact, in m.
    """

    behind_contact: Annotated[float, Field(ge=0.25, le=5.0)]
    lateral_about_contact: Annotated[float, Field(ge=0.1, le=5.0)]


class RigFile(Settings):
    """A rig file: every key is required, unknown keys are errors.

    Attributes:
        schema_name: Version of the file format.
        vehicle_frame: Description of the vehicle frame; for information.
        image: Frames of the camera.
        camera_matrix: Intrinsic matrix in pixels.
        dist_coeffs: Lens distortion.
        R_vehicle_camera: Turns camera coordinates (x right, y down, z ahead) into vehicle coordinates.
        t_vehicle_camera: Camera in the vehicle frame: origin at the projection of the centre of mass on the
            wheel-contact plane, x forward, y left, z up.
        wheel: The observed wheel; None for a camera that measures the motion of the ground only.
        other_wheels: The other wheels. Those with a `contact_point` may leave traces next to the wheel's
            own; all other keys are for information.
        b_m: Distance between the rear axle and the centre of mass.
        nominal_speed_mps: Speed assumed where the telemetry has none, in m/s.
        ground_view_m: Ground in view; None without a wheel: all that the camera sees well.
        max_slip_angle_deg: Largest angle that a trace may have.
    """

    schema_name: Annotated[Literal["rear-camera-rig/1"], Field(alias="schema")]
    vehicle_frame: str
    image: ImageFormat
    camera_matrix: Matrix
    dist_coeffs: Distortion
    R_vehicle_camera: Matrix
    t_vehicle_camera: Triple
    wheel: Wheel | None
    other_wheels: JsonValue
    b_m: float
    nominal_speed_mps: Positive
    ground_view_m: GroundView | None
    max_slip_angle_deg: Annotated[float, Field(ge=5, le=50)]

    @model_validator(mode="after")
    def _has_view_of_wheel(self) -> Self:
        if (self.wheel is None) != (self.ground_view_m is None):
            raise ValueError("wheel and ground_view_m belong together: give both, or null for both")
        return self

    def geometry(self) -> RigGeometry:
        """Return what the estimators need."""
        wheel, view = self.wheel, self.ground_view_m
        if wheel is None or view is None:
            contact_m, behind_m, lateral_m = self._seen_ground()
        else:
            contact_m, behind_m, lateral_m = (
                np.array(wheel.contact_point),
                view.behind_contact,
                view.lateral_about_contact,
            )
        return RigGeometry(
            width=self.image.width,
            height=self.image.height,
            camera_matrix=np.array(self.camera_matrix),
            distortion=np.array(self.dist_coeffs.values),
            rotation=np.array(self.R_vehicle_camera),
            position_m=np.array(self.t_vehicle_camera),
            contact_m=contact_m,
            wheel_width_m=0.0 if wheel is None else wheel.width_m,
            wheel_radius_m=0.0 if wheel is None else wheel.radius_m + wheel.grouser_height_m,
            lead_m=None if wheel is None else self._lead_m(wheel),
            steer_rad=0.0 if wheel is None else float(np.radians(wheel.steer_deg)),
            behind_m=behind_m,
            lateral_m=lateral_m,
            max_slip_rad=float(np.radians(self.max_slip_angle_deg)),
            nominal_speed_m_s=self.nominal_speed_mps,
        )

    def size_conflict(self, width: int, height: int) -> str:
        """Return why this is not the rig of a camera with frames of that size; "" when it may be."""
        size, camera_size = (self.image.width, self.image.height), (width, height)
        if size == camera_size:
            return ""
        return f"scomp.rig is of frames of {size} pixels, the camera gives {camera_size}: make them equal"

    def _seen_ground(self) -> tuple[Floats, float, float]:
        """Return the front middle, length and half width of the ground that the camera sees well.

        There, a pixel covers at most `COARSEST` times as much ground along its ray as where it covers least.
        The plain pinhole is enough for that. Zeros where the camera sees no ground.
        """
        columns, rows = np.meshgrid(
            np.linspace(0, self.image.width - 1, VIEW_RAYS), np.linspace(0, self.image.height - 1, VIEW_RAYS)
        )
        pixels = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)])
        rays = np.array(self.R_vehicle_camera) @ np.linalg.solve(np.array(self.camera_matrix), pixels)
        camera = np.array(self.t_vehicle_camera)
        down = -rays[2] / np.linalg.norm(rays, axis=0)
        rays, down = rays[:, down > LEAST_LOOK_DOWN], down[down > LEAST_LOOK_DOWN]
        if camera[2] <= 0 or down.size == 0:
            return np.zeros(3), 0.0, 0.0
        # A pixel covers (distance)^2 / (height f) of the ground along its ray; distance = height / down.
        well = (down.max() / down) ** 2 < COARSEST
        x, y = (camera[:, None] - rays * (camera[2] / rays[2]))[:2, well]
        (right, left), (rear, front) = np.percentile(y, VIEW_PERCENTILES), (x.min(), x.max())
        middle = np.array([front, (left + right) / 2, 0.0])
        return middle, float(front - rear), float((left - right) / 2)

    def _lead_m(self, wheel: Wheel) -> tuple[float, float] | None:
        """Return the next wheel ahead in about the same track."""
        x, y, _ = wheel.contact_point
        others = [(ahead - x, left - y) for ahead, left in _contact_points(self.other_wheels)]
        leads = [lead for lead in others if lead[0] > wheel.radius_m and abs(lead[1]) < lead[0] / 2]
        return min(leads, key=lambda lead: (round(abs(lead[1]), 1), lead[0]), default=None)


def _contact_points(wheels: JsonValue) -> list[tuple[float, float]]:
    """Return x, y of the wheels that have a valid contact point; skip all other entries."""
    entries = list(wheels.values()) if isinstance(wheels, dict) else wheels
    if not isinstance(entries, list):
        return []
    found = []
    for entry in entries:
        try:
            x, y, _ = OtherWheel.model_validate(entry).contact_point
        except ValidationError:
            continue
        found.append((x, y))
    return found
