"""How fast the rear scene is drawn, how near its truth is to its pictures, and what they look like.

    python -m benchmarks.ftrace.rear_scene [--pictures FOLDER]

prints JSON per named set, for one development and one held-out drive: frames per second of processor time on
one core at 640 x 480 (ruts, light, view, blur and noise; the first frames, which make the ground and compile,
excluded), the slowest frame, and how far the visible trace's direction is off the current one (rms, deg).
Exit code 1 when any set is drawn at less than 30 frames/s; `sparse`, with 4 s of driving per frame, may be.
`--pictures` writes four frames of each drive.
"""

import argparse
import json
import sys
from pathlib import Path

import cv2
import numpy as np

from drivers.clock import NANOSECONDS_PER_SECOND, stopwatch_ns
from drivers.samples import Image
from tests.rear_scene.sequence import FrameSequence
from tests.rear_scene.sets import FIRST_HELD_OUT_SEED, SET_NAMES, make_sequence

WARM_UP_FRAMES = 5
FRAMES = 100
FRAME_RATE_BAR_HZ = 30.0
SEEDS = (0, FIRST_HELD_OUT_SEED)


def measure(sequence: FrameSequence) -> tuple[dict[str, float], list[Image]]:
    """Return the figures of a drive, and its frames."""
    times_s, images = [], []
    frames = sequence.frames()
    for _ in range(min(FRAMES, len(sequence))):
        start_ns = stopwatch_ns()
        images.append(next(frames))
        times_s.append((stopwatch_ns() - start_ns) / NANOSECONDS_PER_SECOND)
    drawn = np.array(times_s[WARM_UP_FRAMES:])
    present = [truth for truth in sequence.truth if truth.trace_present]
    off = [truth.theta_t_deg - truth.line_deg for truth in present]
    figures = {
        "frames_per_s": round(float(1 / drawn.mean()), 1),
        "slowest_ms": round(float(1e3 * drawn.max()), 1),
        "line_off_rms_deg": round(float(np.sqrt(np.mean(np.square(off)))), 2) if off else 0.0,
        "trace_present": round(len(present) / len(sequence), 2),
    }
    return figures, images


def main() -> int:
    """Measure every set; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=Path)
    folder: Path | None = parser.parse_args().pictures
    cv2.setNumThreads(1)
    report: dict[str, dict[str, float]] = {}
    for name in SET_NAMES:
        for seed in SEEDS:
            figures, images = measure(make_sequence(name, seed))
            report[f"{name}/{seed}"] = figures
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
                shown = [images[round(share * (len(images) - 1))] for share in (0.1, 0.4, 0.7, 1.0)]
                sheet = np.vstack([np.hstack(shown[:2]), np.hstack(shown[2:])])
                cv2.imwrite(str(folder / f"{name}_{seed}.jpg"), sheet)
    sys.stdout.write(json.dumps(report, indent=2) + "\n")
    slowest = min(
        figures["frames_per_s"] for name, figures in report.items() if not name.startswith("sparse")
    )
    return 0 if slowest >= FRAME_RATE_BAR_HZ else 1


if __name__ == "__main__":
    sys.exit(main())
