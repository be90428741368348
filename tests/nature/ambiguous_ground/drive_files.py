"""Writes a drive as a folder."""

import json
from pathlib import Path

import cv2
import numpy as np

from tests.nature.ambiguous_ground.motion import telemetry_rows, truth_rows
from tests.nature.ambiguous_ground.picture import Params
from tests.nature.ambiguous_ground.recipe import FPS, Recipe, generator, pictures


def facts(recipe: Recipe) -> Params:
    """What scene.json says of the drive."""
    motion, camera = recipe.motion, recipe.camera
    return {
        "look": recipe.case,
        "case": recipe.case,
        "draw": recipe.draw,
        "frames": recipe.frames,
        "fps": FPS,
        "ground": recipe.kind,
        "height_m": round(camera.position[2], 4),
        "depression_deg": round(camera.depression_deg, 3),
        "yaw_deg": round(camera.yaw_deg, 3),
        "focal_px": round(camera.focal, 2),
        "travel_mm_per_frame": round(1000.0 * float(motion.travel.mean()), 3),
        "mean_slip": round(float(motion.slip.mean()), 4),
        "turned_deg": round(float(np.degrees(motion.psi[-1] - motion.psi[0])), 2),
        "contrast_grey": round(recipe.contrast, 2),
        "noise_grey": round(recipe.noise, 2),
        "speed_of": "wheel" if recipe.centre is None else "rover",
        **recipe.params,
    }


def write(recipe: Recipe, folder: Path) -> None:
    """Render a drive into a folder."""
    frames = folder / "frames"
    frames.mkdir(parents=True, exist_ok=True)
    for i, picture in enumerate(pictures(recipe)):
        cv2.imwrite(str(frames / f"{i:06d}.png"), picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    speed = float(recipe.motion.wheel.mean()) * FPS
    rig = recipe.told.rig(FPS, speed or recipe.travel * FPS)
    (folder / "rig.json").write_text(json.dumps(rig, indent=1))
    noise = generator(recipe.case, recipe.draw, 2)
    rows = telemetry_rows(recipe.motion, noise, of_rover=recipe.centre is not None)
    (folder / "telemetry.csv").write_text("\n".join(rows) + "\n")
    (folder / "truth.csv").write_text("\n".join(truth_rows(recipe.motion)) + "\n")
    (folder / "scene.json").write_text(json.dumps(facts(recipe), indent=1))
