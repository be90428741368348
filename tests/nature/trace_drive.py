"""Drives of a rover with a rearward camera, as nature has them: motion, rig, telemetry and exact truth.

Nothing of the program is used. The motion is prescribed at the contact of the rear left wheel: speed and
direction of that contact against the wheel's axis, and the turn of the body; all else follows from that.
World: x, y on flat ground, z up. Vehicle: x forward, y left, z up. Camera: x right, y down, z ahead.
"""

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

SETS = (
    "easy", "texture", "shadow", "overlap", "curved", "drop_out", "no_trace", "field_1", "field_2", "sparse",
)  # fmt: skip
RATE_HZ = 100
FRAMES_HZ = 5.0
SPARSE_STEP_M = 0.32
LEAD_M = 1.2
"""Way driven before the first frame, where the drive is already under way then."""
PRESENT_M = 0.20
REMEMBERED_M = 2.5
POINT_M = 0.005
WIDTH, HEIGHT = 640, 480
LOWEST_RAY = 0.08


@dataclass(frozen=True, kw_only=True)
class Wheel:
    """A wheel, its contact in the vehicle frame in m; `steer_rad` counter-clockwise."""

    name: str
    x_m: float
    y_m: float
    radius_m: float
    width_m: float
    lug_count: int
    lug_m: float
    steer_rad: float


@dataclass(frozen=True, kw_only=True)
class Camera:
    """OpenCV's pinhole with k1 k2 p1 p2 k3; the columns of `axes` are its axes in the vehicle frame."""

    matrix: Floats
    distortion: Floats
    axes: Floats
    place_m: Floats

    def pixels(self, points_m: Floats) -> Floats:
        """Return (column, row) of vehicle points (n, 3); NaN behind the camera."""
        local = (points_m - self.place_m) @ self.axes
        far_off = np.hypot(local[:, 0], local[:, 1]) > 1.3 * local[:, 2]
        local[far_off] = (0.0, 0.0, 1.0)
        none = np.zeros(3)
        found = cv2.projectPoints(local[:, None], none, none, self.matrix, self.distortion)[0]
        pixels = np.asarray(found, np.float64)[:, 0]
        pixels[far_off] = np.nan
        return pixels

    def rays(self, step: int) -> Floats:
        """Return directions in the vehicle frame through every `step`-th pixel, from the first one on."""
        columns, rows = np.arange(0, WIDTH + step, step), np.arange(0, HEIGHT + step, step)
        if step == 1:
            columns, rows = columns[:-1], rows[:-1]
        grid = np.stack(np.meshgrid(columns, rows), axis=-1).astype(np.float64)
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-7)
        plain = cv2.undistortPoints(grid.reshape(-1, 1, 2), self.matrix, self.distortion, criteria=stop)
        local = np.insert(np.asarray(plain, np.float64)[:, 0], 2, 1.0, axis=1)
        return np.asarray((local @ self.axes.T).reshape(*grid.shape[:2], 3))


@dataclass(frozen=True, kw_only=True)
class Motion:
    """One row per 1 / `RATE_HZ` s.

    Attributes:
        origin_m: World place of the vehicle's origin, (n, 2).
        yaw_rad: Heading.
        rate_rad_s: Of the body about x, y, z, (n, 3).
        rock_rad: Lean of the body against the ground about x and y, (n, 2).
        theta_rad: Direction of the rear left contact's velocity against that wheel's axis.
        way_m: Way of that contact since the start.
        rim_m_s: Speed of the rims.
        hard_m: Where the ground takes no rut: rows of first and last way of the watched wheel, m.
    """

    origin_m: Floats
    yaw_rad: Floats
    rate_rad_s: Floats
    rock_rad: Floats
    theta_rad: Floats
    way_m: Floats
    rim_m_s: Floats
    hard_m: Floats

    def wheel_way(self, wheel: Wheel) -> Floats:
        """Return the world places of a wheel's contact, (n, 2)."""
        return self.origin_m + turned(np.array([wheel.x_m, wheel.y_m]), self.yaw_rad)

    def takes_rut(self, way_m: Floats) -> Flags:
        """Return whether the ground takes a rut that far along the watched wheel's way."""
        hard = (way_m[:, None] >= self.hard_m[:, 0]) & (way_m[:, None] < self.hard_m[:, 1])
        return ~np.asarray(hard.any(axis=1), np.bool_)


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Truth of a frame; angles in degrees from the watched wheel's axis, counter-clockwise.

    Attributes:
        theta_deg: Direction of the watched contact's velocity.
        distance_m: Of the line through the contact in that direction from the origin, left positive.
        chord_deg: From the farthest to the nearest visible point of the centre line.
        chord_distance_m: Of that line from the origin.
        visible_m: Length of the centre line in the picture, not hidden by the wheel.
        present: At least 0.20 m of it in a usable frame.
    """

    frame: int
    t: float
    theta_deg: float
    distance_m: float
    chord_deg: float
    chord_distance_m: float
    visible_m: float
    present: bool
    usable: bool


@dataclass(frozen=True, kw_only=True)
class Told:
    """A row of the telemetry file."""

    frame: int
    t: float
    wheel_speed_mps: float
    compass_deg: float
    gyro_roll_dps: float
    gyro_pitch_dps: float
    gyro_yaw_dps: float


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A drive; `wheels[0]` is the watched one, at `steps` of the motion frames are taken."""

    name: str
    seed: int
    camera: Camera
    wheels: tuple[Wheel, ...]
    motion: Motion
    steps: tuple[int, ...]
    gain: tuple[float, ...]
    nominal_m_s: float
    frames_hz: float

    def truth(self) -> list[Truth]:
        """Return the truth of every frame."""
        return [self._truth_of(frame, step) for frame, step in enumerate(self.steps)]

    def centre_line(self, step: int) -> tuple[Floats, Flags, Floats]:
        """Return the trace's centre line, newest point first: vehicle points (n, 3), visible, steps (m)."""
        motion, wheel = self.motion, self.wheels[0]
        ways = np.arange(motion.way_m[step], max(motion.way_m[step] - REMEMBERED_M, 0.0) - 1e-9, -POINT_M)
        when = np.interp(ways, motion.way_m[: step + 1], np.arange(step + 1.0))
        way = motion.wheel_way(wheel)
        world = np.stack([np.interp(when, np.arange(len(way)), way[:, k]) for k in (0, 1)], axis=1)
        local = turned(world - motion.origin_m[step], np.full(len(world), -motion.yaw_rad[step]))
        points = np.insert(local, 2, 0.0, axis=1)
        pixels = self.camera.pixels(points @ rocked(*motion.rock_rad[step]))
        visible = (pixels >= 0).all(axis=1) & (pixels <= (WIDTH - 1, HEIGHT - 1)).all(axis=1)
        visible &= ~hides(wheel, self.camera.place_m, points - self.camera.place_m)
        visible &= motion.takes_rut(ways)
        return points, visible, ways

    def _truth_of(self, frame: int, step: int) -> Truth:
        wheel, motion = self.wheels[0], self.motion
        points, visible, _ = self.centre_line(step)
        seen = points[visible, :2]
        gaps = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
        visible_m = float(gaps[visible[1:] & visible[:-1]].sum())
        chord = chord_distance = math.nan
        if visible_m > 0:
            chord = math.atan2(*(seen[0] - seen[-1])[::-1])
            chord_distance = passes(seen[0], chord)
        heading = float(motion.theta_rad[step]) + wheel.steer_rad
        usable = 0.2 <= self.gain[frame] <= 2.5
        return Truth(
            frame=frame,
            t=step / RATE_HZ,
            theta_deg=math.degrees(motion.theta_rad[step]),
            distance_m=passes(np.array([wheel.x_m, wheel.y_m]), heading),
            chord_deg=math.degrees(chord - wheel.steer_rad),
            chord_distance_m=chord_distance,
            visible_m=visible_m,
            present=usable and visible_m >= PRESENT_M,
            usable=usable,
        )

    def telemetry(self) -> list[Told]:
        """Return what gyro, compass and encoders say: biased, noisy, the compass late."""
        rng = np.random.default_rng([self.seed, 77])
        bias, scale = rng.normal(0, 0.15, 3), 1 + rng.normal(0, 0.01)
        off, swing, phase = rng.normal(0, 2), rng.uniform(0, 2), rng.uniform(0, 2 * np.pi)
        rows, motion = [], self.motion
        for frame, step in enumerate(self.steps):
            gyro = np.degrees(motion.rate_rad_s[max(step - 4, 0) : step + 1].mean(axis=0)) + bias
            gyro += rng.normal(0, 0.1, 3)
            late = motion.yaw_rad[max(0, step - RATE_HZ // 3)]
            compass = math.degrees(late) + off + swing * math.sin(late + phase) + rng.normal(0, 0.5)
            rows.append(
                Told(
                    frame=frame,
                    t=step / RATE_HZ,
                    wheel_speed_mps=float(motion.rim_m_s[step] * scale + rng.normal(0, 0.001)),
                    compass_deg=float(compass % 360),
                    gyro_roll_dps=float(gyro[0]),
                    gyro_pitch_dps=float(gyro[1]),
                    gyro_yaw_dps=float(gyro[2]),
                )
            )
        return rows

    def rig(self) -> dict[str, object]:
        """Return what a rig file of schema rear-camera-rig/1 holds."""
        wheels = [
            {
                "name": wheel.name,
                "contact_point": [wheel.x_m, wheel.y_m, 0.0],
                "radius_m": wheel.radius_m,
                "width_m": wheel.width_m,
                "grouser_height_m": wheel.lug_m,
                "lug_count": wheel.lug_count,
                "steer_deg": math.degrees(wheel.steer_rad),
            }
            for wheel in self.wheels
        ]
        return {
            "schema": "rear-camera-rig/1",
            "vehicle_frame": "origin below G on the wheel-contact plane, X forward, Y left, Z up",
            "image": {"width": WIDTH, "height": HEIGHT, "fps": self.frames_hz, "format": "bgr8"},
            "camera_matrix": self.camera.matrix.tolist(),
            "dist_coeffs": {"model": "opencv", "values": self.camera.distortion.tolist()},
            "R_vehicle_camera": self.camera.axes.tolist(),
            "t_vehicle_camera": self.camera.place_m.tolist(),
            "wheel": wheels[0],
            "other_wheels": wheels[1:],
            "b_m": -self.wheels[0].x_m,
            "nominal_speed_mps": self.nominal_m_s,
            "ground_view_m": {"behind_contact": 0.7, "lateral_about_contact": 0.4},
            "max_slip_angle_deg": 35.0,
        }

    def write(self, folder: Path, frames: Sequence[NDArray[np.uint8]]) -> None:
        """Write rig.json, telemetry.csv, truth.csv and the frames, given in order, as PNG."""
        (folder / "frames").mkdir(parents=True)
        (folder / "rig.json").write_text(json.dumps(self.rig(), indent=1), "utf-8")
        tables: dict[str, Sequence[Told] | Sequence[Truth]] = {
            "telemetry": self.telemetry(),
            "truth": self.truth(),
        }
        for name, rows in tables.items():
            with (folder / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
                writer = csv.DictWriter(file, [field.name for field in fields(rows[0])])
                writer.writeheader()
                for row in rows:
                    writer.writerow({k: int(v) if isinstance(v, bool) else v for k, v in asdict(row).items()})
        for number, frame in enumerate(frames):
            cv2.imwrite(str(folder / "frames" / f"{number:05d}.png"), frame)


def turned(vectors: Floats, by_rad: Floats) -> Floats:
    """Return vectors (2,) or (n, 2), turned counter-clockwise by n angles."""
    cosine, sine = np.cos(by_rad), np.sin(by_rad)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def rocked(roll: float, pitch: float) -> Floats:
    """Return what turns points of the body into the level vehicle frame."""
    about_x, about_y = cv2.Rodrigues(np.array([roll, 0.0, 0.0]))[0], cv2.Rodrigues(np.array([0, pitch, 0]))[0]
    return np.asarray(about_y @ about_x, np.float64)


def hides(wheel: Wheel, start_m: Floats, rays: Floats) -> Flags:
    """Return which rays (..., 3) from a vehicle point meet the wheel before their end."""
    middle = start_m - np.array([wheel.x_m, wheel.y_m, wheel.radius_m])
    back = np.array(-wheel.steer_rad)
    foot, way = turned(middle[:2], back), turned(rays[..., :2], back)
    x, y, z = foot[0], foot[1], middle[2]
    along, aside, up = way[..., 0], way[..., 1], rays[..., 2]
    a, b = along**2 + up**2, x * along + z * up
    inside = b**2 - a * (x**2 + z**2 - (wheel.radius_m + wheel.lug_m) ** 2)
    root = np.sqrt(np.maximum(inside, 0.0))
    safe = np.where(np.abs(aside) > 1e-9, aside, 1e-9)
    walls = (np.sign(safe)[..., None] * np.array([-0.5, 0.5]) * wheel.width_m - y) / safe[..., None]
    first = np.maximum((-b - root) / a, walls[..., 0])
    last = np.minimum((-b + root) / a, walls[..., 1])
    return np.asarray((inside > 0) & (first < last) & (last > 0) & (first < 0.97), np.bool_)


def passes(point: Floats, heading_rad: float) -> float:
    """Return how far left of the origin the line through a point in a direction passes."""
    return float(point[1] * math.cos(heading_rad) - point[0] * math.sin(heading_rad))
