"""Renders a drive: frames with truth and telemetry, as an iterator or as a folder of files."""

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np

from tests.nature.ground_drives.camera import HEIGHT, WIDTH, Imager, Rig
from tests.nature.ground_drives.draw import World, draw_world, generator
from tests.nature.ground_drives.light import shade
from tests.nature.ground_drives.motion import telemetry
from tests.nature.ground_drives.noise import Bytes, Image, Points, image

PRESENT_M = 0.20
"""A trace is present if at least this length of it is in the picture."""


@dataclass(frozen=True)
class Truth:
    """Truth of a frame, as in `truth.csv`: degrees, m; counter-clockwise in the rover's frame.

    `theta_t_deg` is the direction of the observed wheel's velocity, `d_t_m` the distance of the rover's
    origin from the line through the contact in that direction, `theta_chord_deg` the chord between the ends
    of the visible trace (nan if not present), `beta_deg` the side slip of the rover's origin, `psi_deg` the
    heading.
    """

    present: int
    visible_len_m: float
    theta_t_deg: float
    d_t_m: float
    theta_chord_deg: float
    beta_deg: float
    slip: float
    x: float
    y: float
    psi_deg: float


@dataclass(frozen=True)
class Telemetry:
    """Measurements of a frame, as in `telemetry.csv`."""

    wheel_speed_mps: float
    compass_deg: float
    gyro_roll_dps: float
    gyro_pitch_dps: float
    gyro_yaw_dps: float


@dataclass(frozen=True)
class Frame:
    """One frame: `picture` is (480, 640, 3) blue, green, red before compression, `jpeg` the compressed file.

    `printing` is whether the ground under the observed wheel takes a print now; it is not in the files.
    """

    number: int
    time_s: float
    picture: Bytes
    jpeg: bytes
    telemetry: Telemetry
    truth: Truth
    printing: bool


class Renderer:
    """Renders the frames of one drive in order.

    `world` may be given to render a changed drive; it is drawn from scene, seed and number of frames
    otherwise. `measured` is the telemetry of all frames.
    """

    def __init__(self, scene: str, seed: int, frames: int, world: World | None = None) -> None:
        world = draw_world(scene, seed, frames) if world is None else world
        self.world = world
        x, y = world.ground.coordinates()
        relief = world.ground.height + (
            image(world.terrain.height_m(x, y)) if len(world.terrain.mounds) else 0.0
        )
        self._relief = image(cv2.GaussianBlur(image(relief), (0, 0), 0.003 / world.ground.cell_m))
        self._light = shade(world.ground, world.terrain, world.sun)
        columns, rows = np.meshgrid(np.arange(WIDTH, dtype=np.float64), np.arange(HEIGHT, dtype=np.float64))
        self._rays = image(world.rig.rays(columns.ravel(), rows.ravel()))
        self._open_sky = world.shadows.hidden_sky(world.body)
        self._imager = Imager(generator(scene, seed, "imager"), world.sensor)
        noise = generator(scene, seed, "telemetry")
        measured = telemetry(noise, world.motion, world.times_s, world.sensors, world.compass_rad)
        self.measured = [Telemetry(*row) for row in measured]
        self._path = world.motion.contact(world.rig.contact)
        self._soft = world.softness.at(self._path[:, 0])

    @property
    def rig(self) -> Rig:
        """Camera and wheels."""
        return self.world.rig

    def frames(self) -> Iterator[Frame]:
        """Yield the frames; may be called once, as exposure has a memory."""
        for number, time_s in enumerate(self.world.times_s):
            picture = self._imager.expose(self.light(float(time_s)), self._smear_px(float(time_s)))
            jpeg = self._imager.compress(picture)
            contact = int(np.searchsorted(self.world.motion.time_s, time_s))
            yield Frame(
                number,
                float(time_s),
                picture,
                jpeg,
                self.measured[number],
                self.truth(float(time_s)),
                bool(self._soft[contact] > 0.5),
            )

    def pose(self, time_s: float) -> tuple[float, float, float]:
        """Return x, y in m and heading in rad."""
        motion = self.world.motion
        return motion.at(motion.x, time_s), motion.at(motion.y, time_s), motion.at(motion.heading_rad, time_s)

    def orientation(self, time_s: float) -> Points:
        """Return the (3, 3) rotation from the rover's frame to the world."""
        heading = self.pose(time_s)[2]
        cos, sin = np.cos(heading), np.sin(heading)
        turn = np.asarray(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
        return np.asarray(turn @ self.world.motion.tilt(time_s), np.float64)

    def seen_ground(self, time_s: float) -> tuple[Image, Image, Image]:
        """Return x, y, z in the world of the ground that each pixel sees, m (fixed-point iteration)."""
        world = self.world
        x0, y0, _ = self.pose(time_s)
        turn = self.orientation(time_s)
        level = world.motion.at(world.motion.level_m, time_s)
        eye = turn @ world.rig.position + (x0, y0, level)
        rays = self._rays @ image(turn).T
        slope_x = (rays[:, 0] / rays[:, 2]).reshape(HEIGHT, WIDTH)
        slope_y = (rays[:, 1] / rays[:, 2]).reshape(HEIGHT, WIDTH)
        z = np.full((HEIGHT, WIDTH), level, np.float32)
        for _ in range(4 if len(world.terrain.mounds) else 2):
            x, y = eye[0] + (z - np.float32(eye[2])) * slope_x, eye[1] + (z - np.float32(eye[2])) * slope_y
            z = self._look_up(self._relief, image(x), image(y))
        x, y = eye[0] + (z - np.float32(eye[2])) * slope_x, eye[1] + (z - np.float32(eye[2])) * slope_y
        return image(x), image(y), z

    def _look_up(self, values: Image, x: Image, y: Image) -> Image:
        ground = self.world.ground
        column = (x - np.float32(ground.origin[0])) / np.float32(ground.cell_m)
        row = (y - np.float32(ground.origin[1])) / np.float32(ground.cell_m)
        return image(cv2.remap(values, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT))

    def light(self, time_s: float) -> Image:
        """Return the linear light that each pixel receives, (480, 640, 3)."""
        world = self.world
        x, y, z = self.seen_ground(time_s)
        albedo = self._look_up(world.ground.albedo, x, y)
        shading = self._look_up(self._light, x, y)
        pose = self.pose(time_s)
        plane = world.shadows
        passed = plane.transmission(world.sun, pose, world.motion.tilt(time_s), time_s)
        rise = z - np.float32(world.motion.at(world.motion.level_m, time_s))
        away_x = x + rise * np.float32(world.sun.shift[0]) - np.float32(pose[0])
        away_y = y + rise * np.float32(world.sun.shift[1]) - np.float32(pose[1])
        cos, sin = np.float32(np.cos(pose[2])), np.float32(np.sin(pose[2]))
        column = (cos * away_x + sin * away_y - np.float32(plane.left_back[0])) / np.float32(plane.cell_m)
        row = (cos * away_y - sin * away_x - np.float32(plane.left_back[1])) / np.float32(plane.cell_m)
        fixed = cv2.remap(
            np.dstack((passed, self._open_sky)),
            column,
            row,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        cloud = world.motion.at(world.cloud, time_s)
        direct = shading[..., 0] * image(fixed[..., 0]) * np.float32(cloud)
        sky = shading[..., 1] * image(fixed[..., 1]) * np.float32(1.0 + 0.5 * (1.0 - cloud))
        colour_sun, colour_sky = world.sun.sun.astype(np.float32), world.sun.sky.astype(np.float32)
        return image(albedo * (direct[..., None] * colour_sun + sky[..., None] * colour_sky))

    def _smear_px(self, time_s: float) -> Points:
        """Return how far the ground in the middle of the picture moves while the shutter is open, pixels."""
        world = self.world
        half = 0.5 * world.sensor.blur_s
        middle = (
            world.rig.position[2] * world.rig.rotation[:, 2] / -world.rig.rotation[2, 2] + world.rig.position
        )
        point = self.orientation(time_s) @ middle + (*self.pose(time_s)[:2], 0.0)
        pixels = []
        for moment in (time_s - half, time_s + half):
            local = (point - (*self.pose(moment)[:2], 0.0)) @ self.orientation(moment)
            pixels.append(world.rig.pixels(local[None])[0][0])
        return np.asarray(pixels[1] - pixels[0], np.float64)

    def visible_trace(self, time_s: float) -> tuple[Points, np.ndarray]:
        """Return the trace's centre line so far in the rover's frame, (n, 3) in m, and which points are seen.

        The last point is the contact. Points where the ground takes no print are not seen.
        """
        world = self.world
        count = int(np.searchsorted(world.motion.time_s, time_s, side="right"))
        points = self._path[:count]
        x0, y0, _ = self.pose(time_s)
        level = world.motion.at(world.motion.level_m, time_s)
        height = world.terrain.height_m(points[:, 0], points[:, 1]) - level
        local = np.column_stack((points - (x0, y0), height)) @ self.orientation(time_s)
        seen = world.rig.pixels(local)[1] & (self._soft[:count] > 0.5)
        return local, seen

    def truth(self, time_s: float) -> Truth:
        """Return the truth at a time."""
        world = self.world
        motion, contact = world.motion, world.rig.contact
        theta = motion.at(motion.wheel_direction_rad(contact), time_s)
        local, seen = self.visible_trace(time_s)
        steps = np.hypot(*np.diff(local[:, :2], axis=0).T)
        length = float(steps[seen[1:] & seen[:-1]].sum())
        present = length >= PRESENT_M
        chord = np.nan
        if present:
            first, last = local[np.flatnonzero(seen)[[0, -1]], :2]
            chord = float(np.degrees(np.arctan2(last[1] - first[1], last[0] - first[0])))
        x, y, heading = self.pose(time_s)
        return Truth(
            int(present),
            length,
            float(np.degrees(theta)),
            float(np.cos(theta) * contact[1] - np.sin(theta) * contact[0]),
            chord,
            float(np.degrees(motion.at(motion.side_slip_rad, time_s))),
            motion.at(motion.slip, time_s),
            x,
            y,
            float(np.degrees(heading)),
        )


def frames_of(scene: str, seed: int, frames: int) -> Iterator[Frame]:
    """Yield the frames of a drive without writing files.

    Raises:
        KeyError: there is no scene type of that name.
    """
    yield from Renderer(scene, seed, frames).frames()


def render(scene: str, seed: int, frames: int, folder: Path) -> None:
    """Write a drive: `frames/`, `rig.json`, `telemetry.csv` and `truth.csv`.

    Args:
        scene: name of a scene type, see `SCENES`.
        seed: the same scene, seed and number of frames give the same files.
        frames: number of frames, at least 2.
        folder: is made if it does not exist.

    Raises:
        KeyError: there is no scene type of that name.
    """
    write(Renderer(scene, seed, frames), folder)


def write(renderer: Renderer, folder: Path) -> None:
    """Write the drive of a renderer whose frames were not taken yet, as `render` does."""
    (folder / "frames").mkdir(parents=True, exist_ok=True)
    (folder / "rig.json").write_text(json.dumps(renderer.rig.as_file(), indent=1), "utf-8")
    with (
        (folder / "telemetry.csv").open("w", newline="", encoding="utf-8") as measured,
        (folder / "truth.csv").open("w", newline="", encoding="utf-8") as true,
    ):
        telemetry_csv, truth_csv = (
            csv.writer(measured, lineterminator="\n"),
            csv.writer(true, lineterminator="\n"),
        )
        telemetry_csv.writerow(["frame", "t", *(item.name for item in fields(Telemetry))])
        truth_csv.writerow(["frame", "t", *(item.name for item in fields(Truth))])
        for frame in renderer.frames():
            (folder / "frames" / f"{frame.number:06d}.jpg").write_bytes(frame.jpeg)
            start = [frame.number, round(frame.time_s, 3)]
            telemetry_csv.writerow([*start, *_rounded(frame.telemetry)])
            truth_csv.writerow([*start, *_rounded(frame.truth)])


def _rounded(record: Telemetry | Truth) -> list[float]:
    values = (getattr(record, item.name) for item in fields(record))
    return [value if isinstance(value, int) else round(value, 5) for value in values]
