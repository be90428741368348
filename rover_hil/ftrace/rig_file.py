"""The calibration of a rearward camera and the wheel it watches: a JSON file, schema `rear-camera-rig/1`."""

import json
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError, field_validator

from controllers.ftrace.rig_geometry import RigGeometry
from drivers.errors import ConfigError
from drivers.settings import Settings
from rover_hil.config import describe_validation_error

SCHEMA = "rear-camera-rig/1"
LARGEST_FILE_BYTES = 1_000_000
LARGEST_ROVER_M = 10.0
OTHER_MODELS = ("fish", "kannala", "equidistant", "rational", "omni", "scaramuzza")

Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]
Place = Annotated[float, Field(ge=-LARGEST_ROVER_M, le=LARGEST_ROVER_M)]
Positive = Annotated[float, Field(gt=0)]
Pixels = Annotated[int, Field(ge=64, le=8192)]


class ImageFormat(Settings):
    """Size in pixels, rate in Hz and pixel format (text) of the frames."""

    width: Pixels
    height: Pixels
    fps: Positive
    format: str


class Distortion(Settings):
    """Lens distortion of OpenCV's plain model: k1 k2 p1 p2 k3."""

    model: str
    values: tuple[float, float, float, float, float]

    @field_validator("model")
    @classmethod
    def _is_plain(cls, name: str) -> str:
        if any(other in name.lower() for other in OTHER_MODELS):
            msg = "only OpenCV's plain model, k1 k2 p1 p2 k3, is known: calibrate with it"
            raise ValueError(msg)
        return name


class Wheel(Settings):
    """The wheel whose trace is seen; its contact point is in the vehicle frame, in metres."""

    name: str
    contact_point: Triple
    radius_m: Positive
    width_m: Annotated[float, Field(ge=0.02, le=1.0)]
    grouser_height_m: Annotated[float, Field(ge=0)]
    lug_count: Annotated[int, Field(ge=0)]
    steer_deg: Annotated[float, Field(ge=-90, le=90)]


class OtherWheel(BaseModel):
    """What counts of another wheel: where it touches the ground, in the vehicle frame, in metres."""

    model_config = ConfigDict(extra="ignore", strict=True, allow_inf_nan=False)

    contact_point: Annotated[list[Place], Field(min_length=3, max_length=3)]


class GroundView(Settings):
    """Ground that the camera sees, in metres: behind the contact, and across it."""

    behind_contact: Annotated[float, Field(ge=0.25, le=5.0)]
    lateral_about_contact: Annotated[float, Field(ge=0.1, le=5.0)]


class RigFile(Settings):
    """A rig file; every key must be there and no other may.

    Attributes:
        image: Frames of the camera.
        camera_matrix: Intrinsic matrix in pixels.
        dist_coeffs: Lens distortion.
        R_vehicle_camera: Turns camera coordinates (x right, y down, z ahead) into vehicle coordinates.
        t_vehicle_camera: Camera in the vehicle frame: origin at the projection of the centre of mass on the
            wheel-contact plane, x forward, y left, z up.
        wheel: The wheel whose trace is seen.
        other_wheels: The others. Those with a `contact_point` like the wheel's may leave traces beside its
            own; all else is for information.
        b_m: Distance between the rear axle and the centre of mass.
        nominal_speed_mps: Speed assumed where telemetry tells none.
        ground_view_m: Ground in view.
        max_slip_angle_deg: Largest angle that a trace may have.
    """

    schema_name: Annotated[Literal["rear-camera-rig/1"], Field(alias="schema")]
    vehicle_frame: str
    image: ImageFormat
    camera_matrix: Matrix
    dist_coeffs: Distortion
    R_vehicle_camera: Matrix
    t_vehicle_camera: Triple
    wheel: Wheel
    other_wheels: JsonValue
    b_m: float
    nominal_speed_mps: Positive
    ground_view_m: GroundView
    max_slip_angle_deg: Annotated[float, Field(ge=5, le=50)]

    def geometry(self) -> RigGeometry:
        """Return what the estimators need."""
        return RigGeometry(
            width=self.image.width,
            height=self.image.height,
            camera_matrix=np.array(self.camera_matrix),
            distortion=np.array(self.dist_coeffs.values),
            rotation=np.array(self.R_vehicle_camera),
            position_m=np.array(self.t_vehicle_camera),
            contact_m=np.array(self.wheel.contact_point),
            wheel_width_m=self.wheel.width_m,
            wheel_radius_m=self.wheel.radius_m + self.wheel.grouser_height_m,
            lead_m=self._lead_m(),
            steer_rad=float(np.radians(self.wheel.steer_deg)),
            behind_m=self.ground_view_m.behind_contact,
            lateral_m=self.ground_view_m.lateral_about_contact,
            max_slip_rad=float(np.radians(self.max_slip_angle_deg)),
            nominal_speed_m_s=self.nominal_speed_mps,
        )

    def _lead_m(self) -> tuple[float, float] | None:
        """Return the next wheel ahead in about the same track."""
        x, y, _ = self.wheel.contact_point
        others = [(ahead - x, left - y) for ahead, left in _contact_points(self.other_wheels)]
        leads = [lead for lead in others if lead[0] > self.wheel.radius_m and abs(lead[1]) < lead[0] / 2]
        return min(leads, key=lambda lead: (round(abs(lead[1]), 1), lead[0]), default=None)


def read_rig(path: Path) -> RigFile:
    """Return the rig in a file.

    Raises:
        ConfigError: It cannot be read, or holds something wrong; the message names the key.
    """
    try:
        table = json.loads(path.read_bytes()[:LARGEST_FILE_BYTES])
        return RigFile.model_validate(table)
    except OSError as error:
        msg = f"cannot read rig file {path}: {error.strerror}"
        raise ConfigError(msg) from error
    except ValidationError as error:
        raise ConfigError(describe_validation_error(str(path), error, _as_table(table))) from error
    except ValueError as error:
        msg = f"rig file {path} is no valid JSON: {error}"
        raise ConfigError(msg) from error


def _as_table(table: object) -> dict[str, object]:
    return table if isinstance(table, dict) else {}


def _contact_points(wheels: JsonValue) -> list[tuple[float, float]]:
    """Return x, y of the wheels that tell where they touch the ground, whatever else the rig file holds."""
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
