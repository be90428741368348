"""A drive as frames with truth and telemetry, and the files that hold it."""

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from drivers.errors import ConfigError
from drivers.samples import Image
from sim_backends.rear_scene.ground_map import GroundSettings, Rut, Sun, WheelStep
from sim_backends.rear_scene.scene import BODY, Boxes, Lens, RearScene
from tests.rear_scene.motion import RATE_HZ, Motion
from tests.rear_scene.rig_file import CalibratedRig
from tests.rear_scene.truth import FrameTruth, SensorErrors, Telemetry, frame_truth, telemetry

PRESSED_STEP_M = 0.004
Row: TypeAlias = FrameTruth | Telemetry


@dataclass(frozen=True, kw_only=True)
class Appearance:
    """All that decides how a drive looks.

    Attributes:
        gain: Exposure of each frame against the nominal one; 0 is black.
    """

    ground: GroundSettings
    sun: Sun
    rut: Rut
    lens: Lens
    gain: tuple[float, ...]
    earlier_steps: tuple[WheelStep, ...] = ()
    body: Boxes = BODY


class FrameSequence:
    """Frames of one drive.

    Args:
        name: Of the set.
        seed: Of the drive within the set.
        rig: Camera and wheels.
        motion: How the rover moves.
        appearance: How it looks.
        errors: Of the other sensors.

    Attributes:
        truth: One entry per frame.
        telemetry: One entry per frame.
    """

    def __init__(
        self,
        name: str,
        seed: int,
        rig: CalibratedRig,
        motion: Motion,
        appearance: Appearance,
        errors: SensorErrors,
    ) -> None:
        self.name = name
        self.seed = seed
        self.rig = rig
        self.motion = motion
        self._appearance = appearance
        period = round(RATE_HZ / rig.fps)
        self._steps = [k * period for k in range(len(appearance.gain))]
        usable = [0.2 <= gain <= 2.5 for gain in appearance.gain]
        self.truth: list[FrameTruth] = [
            frame_truth(rig, motion, step, frame, usable[frame]) for frame, step in enumerate(self._steps)
        ]
        rng = np.random.default_rng([seed, 1])
        self.telemetry: list[Telemetry] = telemetry(motion, self._steps, errors, rng)

    def __len__(self) -> int:
        return len(self._steps)

    def frames(self) -> Iterator[Image]:
        """Render the frames in order of time; each call starts anew and gives the same frames."""
        appearance = self._appearance
        rng = np.random.default_rng([self.seed, 2])
        scene = RearScene(
            self.rig,
            appearance.ground,
            appearance.sun,
            appearance.rut,
            appearance.lens,
            rng,
            appearance.earlier_steps,
            appearance.body,
        )
        pressed = 0
        scene.drive(self.motion.pose(0))
        for step, gain in zip(self._steps, appearance.gain, strict=True):
            while pressed < step:
                pressed = min(step, pressed + self._stride(pressed))
                scene.drive(self.motion.pose(pressed))
            yield scene.render(self.motion.pose(step), gain)

    def _stride(self, step: int) -> int:
        speed = max(1e-3, float(np.hypot(*self.motion.velocity_m_s[step])))
        return max(1, min(RATE_HZ // 5, round(PRESSED_STEP_M / speed * RATE_HZ)))


def write_sequence(sequence: FrameSequence, folder: Path) -> None:
    """Write rig.json, telemetry.csv, truth.csv and the frames as frames/00000.png and so on.

    Raises:
        ConfigError: The folder exists already, or cannot be written.
    """
    try:
        (folder / "frames").mkdir(parents=True)
        (folder / "rig.json").write_text(json.dumps(sequence.rig.as_json(), indent=2) + "\n", "utf-8")
        _write_rows(folder / "telemetry.csv", sequence.telemetry)
        _write_rows(folder / "truth.csv", sequence.truth)
        for frame, image in enumerate(sequence.frames()):
            encoded = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
            (folder / "frames" / f"{frame:05d}.png").write_bytes(encoded.tobytes())
    except OSError as error:
        msg = f"cannot write frames into {folder}: {error.strerror}; choose a new folder"
        raise ConfigError(msg) from error


def _write_rows(path: Path, rows: Sequence[Row]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(rows[0])])
        writer.writeheader()
        for row in rows:
            writer.writerow({key: int(v) if isinstance(v, bool) else v for key, v in asdict(row).items()})
