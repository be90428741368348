"""Where a camera looks, by questions, and its calibration by rulers.

Good enough to begin with: board and drive of `calibrate camera` and `calibrate scale` replace it.
"""

import datetime as dt
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from controllers.ground_motion.rig import SCHEMA, RigFile
from controllers.ground_motion.settings import GroundMotionSettings
from drivers.camera.settings import CameraSettings
from drivers.clock import date_of, wall_time_ns
from drivers.errors import ConfigError
from drivers.overhead_camera.settings import OverheadCameraSettings
from rover_hil.config import validated
from rover_hil.console.ask import again, ask_choice, ask_number, ask_yes
from rover_hil.drives.toml_text import toml_text
from rover_hil.pages.atomic_write import check_file, write_file
from rover_hil.ready.set_up.simulated_rover import RoverTable, WheelTable, wheels_of
from rover_hil.terminal import Terminal

Direction = Literal["ahead", "back", "left", "right"]
View = Literal["ground", "trace", "overhead", "elsewhere"]
YAW_DEG: Mapping[Direction, float] = {"ahead": 0.0, "left": 90.0, "back": 180.0, "right": -90.0}
"""Direction of view, counter-clockwise from ahead."""
TOLERANCE = {"height_sd_m": 0.01, "pitch_sd_deg": 2.0, "focal_length_sd": 0.05}
"""Of rulers, a spirit level and a data sheet: standard deviations."""
LEAST_PERIODS = 2.5
"""Of the frames, until the motion counts as not measured: one frame may be lost."""
MAX_SLIP_ANGLE_DEG = 35.0
LEAST_BEHIND_M, LEAST_LATERAL_M = 0.25, 0.1
"""Least ground to use about a wheel, of the rig file."""
VIEWS: Mapping[View, str] = {
    "ground": "down at the ground, ahead of or behind the rover",
    "trace": "down at the trace of the rear left wheel, from behind and above that wheel",
    "overhead": "from above the site at a marker on the rover",
    "elsewhere": "anywhere else: it measures nothing",
}
FOUR_WHEELS = ("skid_steer_4", "steered_4")
REAR_LEFT = 2
"""Place of that wheel among four."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mounting:
    """A camera above the ground, measured with rulers.

    Attributes:
        looks: Direction of view, seen from above.
        height_m: Of the lens above the ground.
        pitch_deg: Of the middle of the picture below the horizon.
        ahead_m: Of the lens, from the middle of the rover.
        left_m: Of the lens, from the middle of the rover.
        view_deg: Angle of view over the width of the picture.
        is_upside_down: Whether the camera is mounted upside down.
        wheels: The four wheels, where the trace of the rear left one is in view; else none.
        wheel_width_m: Width of the wheels.
    """

    looks: Direction
    height_m: float
    pitch_deg: float
    ahead_m: float
    left_m: float
    view_deg: float
    is_upside_down: bool
    wheels: Sequence[WheelTable] = ()
    wheel_width_m: float = 0.0

    def rig(self, camera: CameraSettings, speed_m_s: float) -> RigFile:
        """Return the rig of the camera, without lens distortion.

        Args:
            camera: Gives size and rate of the frames.
            speed_m_s: Usual speed of the rover.

        Raises:
            ConfigError: The camera does not see the ground to use.
        """
        width, height = camera.width, camera.height
        focal_px = width / 2 / math.tan(math.radians(self.view_deg) / 2)
        table: dict[str, object] = {
            "schema": SCHEMA,
            "vehicle_frame": "origin = middle of the rover on the wheel-contact plane, X forward, Y left",
            "image": {"width": width, "height": height, "fps": camera.frame_rate_hz, "format": "bgr8"},
            "camera_matrix": [
                [focal_px, 0.0, (width - 1) / 2],
                [0.0, focal_px, (height - 1) / 2],
                [0.0, 0.0, 1.0],
            ],
            "dist_coeffs": {"model": "opencv", "values": [0.0] * 5},
            "R_vehicle_camera": self._rotation(),
            "t_vehicle_camera": [self.ahead_m, self.left_m, self.height_m],
            "wheel": None,
            "other_wheels": [],
            "b_m": 0.0,
            "nominal_speed_mps": speed_m_s,
            "ground_view_m": None,
            "max_slip_angle_deg": MAX_SLIP_ANGLE_DEG,
        }
        rig = validated(RigFile, table, "rig")
        if self.wheels:
            rig = validated(RigFile, table | self._wheel(rig), "rig")
        # Imported here because it brings OpenCV, which a rover without a camera must not wait for.
        from controllers.ground_motion.ground_patch import GroundPatch

        GroundPatch(rig.geometry())
        return rig

    def _rotation(self) -> list[list[float]]:
        """Return the camera's right, down and ahead in the axes of the vehicle, as columns."""
        yaw, pitch = math.radians(YAW_DEG[self.looks]), math.radians(self.pitch_deg)
        sign = -1.0 if self.is_upside_down else 1.0
        right = (math.sin(yaw), -math.cos(yaw), 0.0)
        down = (-math.sin(pitch) * math.cos(yaw), -math.sin(pitch) * math.sin(yaw), -math.cos(pitch))
        ahead = (math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), -math.sin(pitch))
        return [
            [round(sign * x, 9), round(sign * y, 9), round(z, 9)]
            for x, y, z in zip(right, down, ahead, strict=True)
        ]

    def _wheel(self, without: RigFile) -> dict[str, object]:
        """Return the keys of the watched wheel, given the rig without it."""
        ground = without.geometry()
        seen = self.wheels[REAR_LEFT]
        rear_m = float(ground.contact_m[0]) - ground.behind_m
        return {
            "wheel": {
                "name": "rear_left",
                "contact_point": [seen["x_m"], seen["y_m"], 0.0],
                "radius_m": seen["radius_m"],
                "width_m": self.wheel_width_m,
                "grouser_height_m": 0.0,
                "lug_count": 0,
                "steer_deg": 0.0,
            },
            "other_wheels": [
                {"contact_point": [wheel["x_m"], wheel["y_m"], 0.0]}
                for place, wheel in enumerate(self.wheels)
                if place != REAR_LEFT
            ],
            "ground_view_m": {
                "behind_contact": max(LEAST_BEHIND_M, seen["x_m"] - rear_m),
                "lateral_about_contact": max(LEAST_LATERAL_M, ground.lateral_m),
            },
        }

    def simulated(self) -> dict[str, object]:
        """Return the simulated camera, [simulation.devices.NAME]."""
        table: dict[str, object] = {
            "type": "camera",
            "leaves_traces": bool(self.wheels),
            "wheel_x_m": self.ahead_m,
            "wheel_y_m": self.left_m,
            "behind_m": 0.0,
            "height_m": self.height_m,
            "tilt_deg": self.pitch_deg,
            "pan_deg": YAW_DEG[self.looks] - YAW_DEG["back"],
            "bank_deg": 180.0 if self.is_upside_down else 0.0,
            "horizontal_view_deg": self.view_deg,
            "distortion": [0.0] * 5,
        }
        if not self.wheels:
            return table | {"rut_depth_m": 0.001, "shadow_of": "nothing"}
        seen = self.wheels[REAR_LEFT]
        return table | {
            "wheel_x_m": seen["x_m"],
            "behind_m": seen["x_m"] - self.ahead_m,
            "trace_width_m": self.wheel_width_m,
        }


def ask_view(name: str, views: Sequence[View], console: Terminal) -> View:
    """Return where a camera looks, one of `views`."""
    for view in views:
        console.print(f"  {view}: {VIEWS[view]}")
    answer = ask_choice(f"Where does {name} look", tuple(views), "elsewhere")
    return next(view for view in views if view == answer)


def ask_mounting(
    camera: CameraSettings, speed_m_s: float, wheels: Sequence[WheelTable]
) -> tuple[Mounting, RigFile]:
    """Ask where a camera is, until it sees the ground; return that with the rig.

    Args:
        camera: Gives size and rate of the frames.
        speed_m_s: Usual speed of the rover.
        wheels: The four wheels, where the trace of the rear left one is in view; else none.
    """
    while True:
        mounting = _ask_once(wheels)
        try:
            return mounting, mounting.rig(camera, speed_m_s)
        except ConfigError as error:
            again("where the camera is", str(error))


def _ask_once(wheels: Sequence[WheelTable]) -> Mounting:
    looks: Direction = "back"
    if not wheels:
        answer = ask_choice("Which way does it look", tuple(YAW_DEG), looks)
        looks = next(each for each in YAW_DEG if each == answer)
    height_m = ask_number("Height of the lens above the ground, m", 0.1, 3.0, 0.5)
    pitch_deg = ask_number(
        "Angle of the middle of the picture below the horizon, deg (90: straight down)", 15.0, 90.0, 60.0
    )
    ahead_m = ask_number(
        "Place of the lens ahead of the middle of the rover, m (behind it: negative)", -5.0, 5.0, -0.2
    )
    left_m = wheels[REAR_LEFT]["y_m"] if wheels else 0.0
    if not wheels:
        left_m = ask_number(
            "Place of the lens to the left of the middle of the rover, m (right: negative)", -5.0, 5.0, left_m
        )
    view_deg = ask_number("Angle of view over the width of the picture, deg", 20.0, 120.0, 60.0)
    return Mounting(
        looks=looks,
        height_m=height_m,
        pitch_deg=pitch_deg,
        ahead_m=ahead_m,
        left_m=left_m,
        view_deg=view_deg,
        is_upside_down=ask_yes("Is the camera mounted upside down?", default=False),
        wheels=wheels,
        wheel_width_m=ask_number("Width of the wheels, m", 0.02, 0.3, 0.1) if wheels else 0.0,
    )


def rig_text(rig: RigFile) -> str:
    """Return the text of a rig file."""
    return json.dumps(rig.model_dump(mode="json", by_alias=True), indent=2) + "\n"


def ground_motion(rig_name: str, frame_rate_hz: float) -> dict[str, object]:
    """Return the section [ground_motion] of a rig by rulers.

    Args:
        rig_name: The rig file, beside the configuration.
        frame_rate_hz: Of the camera.
    """
    usual_s: float = GroundMotionSettings.model_fields["greatest_age_s"].default
    return {
        "rig": rig_name,
        "greatest_age_s": max(usual_s, round(LEAST_PERIODS / frame_rate_hz, 2)),
        "tolerance": dict(TOLERANCE),
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class Overhead:
    """A camera that looks straight down on a marker on the rover.

    Attributes:
        height_m: Of the lens above the floor.
        width_m: Floor over the width of the picture.
    """

    height_m: float
    width_m: float

    def floor_text(self, camera: CameraSettings, today: dt.date) -> str:
        """Return the text of its floor calibration."""
        return toml_text(
            {
                "source": "rulers, by rover-hil init",
                "date": today,
                "width": camera.width,
                "height": camera.height,
                "scale_mm_per_px": 1000.0 * self.width_m / camera.width,
                "camera_m": [0.0, 0.0, self.height_m],
            }
        )

    def simulated(self) -> dict[str, object]:
        """Return the simulated camera, [simulation.devices.NAME]."""
        return {
            "type": "overhead_camera",
            "camera_x_m": 0.0,
            "camera_y_m": 0.0,
            "height_m": self.height_m,
            "tilt_x_deg": 0.0,
            "tilt_y_deg": 0.0,
            "horizontal_view_deg": math.degrees(2.0 * math.atan(0.5 * self.width_m / self.height_m)),
        }


def ask_overhead(camera: CameraSettings, floor_name: str) -> tuple[Overhead, OverheadCameraSettings]:
    """Ask for marker and place of an overhead camera; return the place, and the device.

    Args:
        camera: The camera as it was found.
        floor_name: Its floor calibration, a file.
    """
    height_m = ask_number("Height of the lens above the floor, m", 0.5, 10.0, 2.5)
    width_m = ask_number(
        "Floor from the left to the right edge of the picture, m", 0.2 * height_m, 2.0 * height_m, height_m
    )
    marker = int(ask_number("Number of the marker on the rover (DICT_4X4_50)", 0, 49, 0))
    size_m = ask_number("Side of its black square, m", 0.01, 1.0, 0.12)
    marker_m = ask_number("Height of the marker above the floor, m", 0.0, min(3.0, 0.5 * height_m), 0.2)
    table = camera.model_dump(exclude_defaults=True) | {
        "type": "overhead_camera",
        "marker_id": marker,
        "marker_size_m": size_m,
        "marker_height_m": marker_m,
        "calibration": floor_name,
    }
    return Overhead(height_m=height_m, width_m=width_m), OverheadCameraSettings.model_validate(table)


@dataclass
class Views:
    """What the cameras of a rover look at, camera after camera.

    Attributes:
        out: The configuration; calibrations are written beside it.
        made: Takes the files that were written, and what they held before.
        console: Shows what is written.
        force: Overwrite files.
        camera: Name of the one that sees the ground; None without.
        ground_motion: Its section [ground_motion].
        has_trace: Whether it also sees the trace of the rear left wheel.
        overhead: Those that look at a marker, by name.
        simulated: Tables of [simulation.devices] by name.
    """

    out: Path
    made: dict[Path, bytes | None]
    console: Terminal
    force: bool
    camera: str | None = None
    ground_motion: dict[str, object] = field(default_factory=dict)
    has_trace: bool = False
    overhead: dict[str, OverheadCameraSettings] = field(default_factory=dict)
    simulated: dict[str, dict[str, object]] = field(default_factory=dict)

    def ask(
        self, name: str, camera: CameraSettings, speed_m_s: float, rover: RoverTable, kinematics: str
    ) -> None:
        """Ask where a camera looks and where it is; write its calibration.

        Args:
            name: Name of the device.
            camera: The camera as it was found.
            speed_m_s: Usual speed of the rover.
            rover: The section [rover].
            kinematics: Kind of the rover.

        Raises:
            ConfigError: A calibration exists and may not be overwritten, or nobody answers.
        """
        views: list[View] = ["overhead", "elsewhere"]
        if self.camera is None:  # only one can be used
            views[:0] = ["ground", "trace"] if kinematics in FOUR_WHEELS else ["ground"]
        view = ask_view(name, views, self.console)
        if view == "overhead":
            path = self._path(f"{name}_floor.toml")
            place, self.overhead[name] = ask_overhead(camera, path.name)
            self._write(path, place.floor_text(camera, date_of(wall_time_ns())))
            self.simulated[name] = place.simulated()
        elif view != "elsewhere":
            path = self._path("rig.json")
            self.has_trace = view == "trace"
            wheels = _four_wheels(rover) if self.has_trace else ()
            mounting, rig = ask_mounting(camera, speed_m_s, wheels)
            self._write(path, rig_text(rig))
            self.camera, self.ground_motion = name, ground_motion(path.name, camera.frame_rate_hz)
            self.simulated[name] = mounting.simulated()

    def _path(self, name: str) -> Path:
        path = self.out.with_name(f"{self.out.stem}_{name}")
        check_file(path, force=self.force, option="OUT")
        return path

    def _write(self, path: Path, text: str) -> None:
        self.made[path] = path.read_bytes() if path.exists() else None
        write_file(path, text)
        self.console.print(f"calibration by rulers written: {path}")


def _four_wheels(rover: RoverTable) -> Sequence[WheelTable]:
    """Return where the wheels are; asks for the axles of a rover that skids."""
    if "wheels" in rover:
        return rover["wheels"]
    base_m = ask_number("Distance between front and rear wheels, m", 0.05, 5.0, rover["track_m"])
    return [{**wheel, "x_m": math.copysign(0.5 * base_m, wheel["x_m"])} for wheel in wheels_of(rover)]
