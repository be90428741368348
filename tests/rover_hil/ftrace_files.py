"""A short drive as files, for tests of the trace command."""

import csv
import json
from pathlib import Path
from typing import Any

import cv2

from tests.rear_scene.sequence import write_sequence
from tests.rear_scene.sets import make_sequence
from tests.sim_backends.rear_drives import rig

DURATION_S = 11.0
FRAMES = 55


def write_drive(folder: Path) -> Path:
    """Write rig.json, telemetry.csv, truth.csv and frames."""
    write_sequence(make_sequence("curved", 1, DURATION_S), folder)
    return folder


def rig_table(**changes: Any) -> dict[str, Any]:
    """Return a rig file's content with some keys changed."""
    table: dict[str, Any] = json.loads(json.dumps(rig().as_json()))
    return table | changes


def write_rig(path: Path, table: dict[str, Any]) -> Path:
    path.write_text(json.dumps(table), encoding="utf-8")
    return path


def write_video(frames: Path, path: Path) -> Path:
    """Write pictures as a video without loss."""
    found = [cv2.imread(str(name)) for name in sorted(frames.iterdir())]
    pictures = [picture for picture in found if picture is not None]
    height, width = pictures[0].shape[:2]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 5.0, (width, height))
    for picture in pictures:
        video.write(picture)
    video.release()
    return path


def read_rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))
