"""Renders drives on which the wheels slip more than `tests/nature/ground_drives` lets them, to rolling back.

    python -m benchmarks.ground_motion.slipping_drives FOLDER [--first-seed 100] [--profiles bogged,stuck]

The wheels turn as they would; the rover's own time passes more slowly, stands, or runs back. Passing shadows
keep their time. The rover sinks the deeper, the more it slips, up to 20 mm. One drive of each profile takes
about four minutes on one core.
"""

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.nature.ground_drives import Renderer, write
from tests.nature.ground_drives.draw import World, draw_world

Floats = NDArray[np.float64]

FRAMES = 110
LEAST_PACE = 0.01
"""A pace of exactly 0 has no wheel speed in the renderer's definition of slip."""
SINKAGE_M = (0.005, 0.015)
"""Without slip, and what full slip adds."""


def _steps(share: Floats, *paces: float) -> Floats:
    """Return paces that follow each other smoothly over the drive."""
    places = np.linspace(0.0, 1.0, len(paces))
    return np.asarray(np.interp(share, places, paces), np.float64)


PROFILES: Mapping[str, tuple[str, Callable[[Floats], Floats]]] = {
    "bogged": ("own_easy", lambda share: _steps(share, 1.0, 0.9, 0.5, 0.15, 0.02, 0.02, 0.5, 1.0)),
    "bogged_shadow": ("bare_shadow", lambda share: _steps(share, 0.9, 0.6, 0.4, 0.3, 0.2, 0.1, 0.02)),
    "bogged_foliage": ("own_foliage", lambda share: _steps(share, 1.0, 0.7, 0.35, 0.35, 0.2, 0.6, 0.6)),
    "half": ("own_low_contrast", lambda share: _steps(share, 0.75, 0.6, 0.5, 0.55, 0.7, 0.5)),
    "rolls_back": ("own_hard_shadow", lambda share: _steps(share, 0.9, 0.3, 0.02, -0.3, -0.3, 0.02, 0.9)),
    "stuck": ("bare_shadow", lambda share: _steps(share, 0.01, 0.01)),
    "stuck_foliage": ("bare_foliage", lambda share: _steps(share, 0.6, 0.01, 0.01, 0.01, 0.01)),
}
"""Scene type, and the rover's pace over the share of the drive."""


def slipping(scene: str, seed: int, pace_of: Callable[[Floats], Floats]) -> World:
    """Return a drive whose rover moves at a pace of its own."""
    world = draw_world(scene, seed, FRAMES)
    motion, end_s = world.motion, float(world.times_s[-1])
    time_s = motion.time_s
    pace = np.where(time_s < 0, 1.0, pace_of(np.clip(time_s / end_s, 0.0, 1.0)))
    pace = np.where(np.abs(pace) < LEAST_PACE, LEAST_PACE, pace)
    own_s = np.cumsum(pace) * float(time_s[1] - time_s[0])
    own_s -= np.interp(0.0, time_s, own_s)
    paced = {
        name: np.interp(own_s, time_s, getattr(motion, name))
        for name in ("x", "y", "heading_rad", "side_slip_rad", "roll_rad", "pitch_rad", "level_m")
    }
    slip = 1 - (1 - np.interp(own_s, time_s, motion.slip)) * pace
    sinkage_m = SINKAGE_M[0] + SINKAGE_M[1] * np.clip(slip, 0.0, 1.0)
    paced["level_m"] = paced["level_m"] - cv2.GaussianBlur(sinkage_m, (0, 0), 30.0).ravel()
    changed = replace(
        motion,
        **paced,
        slip=slip,
        speed_mps=np.interp(own_s, time_s, motion.speed_mps) * pace,
        yaw_rate_rad_s=np.interp(own_s, time_s, motion.yaw_rate_rad_s) * pace,
    )
    return replace(world, motion=changed)


def main() -> int:
    """Render the drives."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first-seed", type=int, default=100, help="of the first profile")
    parser.add_argument("--profiles", default=",".join(PROFILES), help="names, with commas between")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    for number, (name, (scene, pace_of)) in enumerate(PROFILES.items()):
        folder = given.folder / f"{name}_{given.first_seed}"
        if name in given.profiles.split(",") and not folder.exists():
            seed = given.first_seed + number
            write(Renderer(scene, seed, FRAMES, slipping(scene, seed, pace_of)), folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
