"""Processor time of an image of the simulated ground camera, clear and disturbed.

    python -m benchmarks.ground_motion.scene_cost

Prints the median over images of 640 x 480 pixels, on one thread, for each disturbance.
"""

import sys
import time
from dataclasses import replace

import cv2
import numpy as np

from rover_hil.config import load_config
from sim_backends.rear_scene.emulated_scene import EmulatedScene
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from tests.controllers.ground_drive import Mount
from tests.controllers.simulated import SECOND_NS, omni_rover

RATE_HZ, SPEED_M_S = 10.0, 0.2
IMAGES = 25
FIRST = 3
"""The first images compile and fill caches."""
DISTURBANCES: dict[str, dict[str, object]] = {
    "clear": {},
    "specks": {"dirt": {"specks": 60}},
    "shadows": {"canopy": {"cover": 0.4}},
    "vibration": {"vibration_deg": 0.1},
    "rolling shutter": {"readout_s": 0.02},
    "motion blur": {"exposure_s": 0.03},
    "out of focus": {"blur_px": 4.0},
}


def image_ms(**changes: object) -> float:
    """Return the time of an image of a rover that drives ahead."""
    shipped = load_config("el-dorado-camera").require_simulation().devices["camera"]
    assert isinstance(shipped, CameraEmulatorSettings)
    scene = EmulatedScene(
        CameraEmulatorSettings.model_validate(shipped.model_dump() | changes),
        640,
        480,
        RATE_HZ,
        np.random.default_rng(0),
        0,
    )
    start, spent_ms = Mount(omni_rover()).truth(), []
    for number in range(IMAGES):
        truth = replace(
            start,
            t_ns=round(number * SECOND_NS / RATE_HZ),
            x_m=number * SPEED_M_S / RATE_HZ,
            velocity_x_m_s=SPEED_M_S,
        )
        started_s = time.thread_time()
        scene.render(truth)
        spent_ms.append(1e3 * (time.thread_time() - started_s))
    return float(np.median(spent_ms[FIRST:]))


def main() -> int:
    """Print the times."""
    cv2.setNumThreads(1)
    everything = {key: value for changes in DISTURBANCES.values() for key, value in changes.items()}
    for name, changes in [*DISTURBANCES.items(), ("all of them", everything)]:
        sys.stdout.write(f"{name}: {image_ms(**changes):.0f} ms\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
