"""Trace finders on rendered drives with exact truth: the paper's, ours, and plain peers, side by side.

    python -m benchmarks.ftrace.rendered_drives [--sets easy,curved] [--seeds 2] [--first-seed 1000]
        [--seconds S] [--methods fused,hough] [--pictures FOLDER]

Every finder gets the same grey frames, wheel speed and gyro of the drives of `tests/rear_scene`. Seeds
from 1000 are held out: nothing was tuned on them. Prints one table per set, one for all but `sparse` (one
image every 32 cm) together, and as JSON what misses a bar; exit code 1 when anything does. One seed of all
sets takes about five minutes; `--sets easy,curved --seconds 20` one.

Definitions: `benchmarks/ftrace/scores.py`.
"""

import argparse
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import get_args

import cv2
import numpy as np

from benchmarks.ftrace.peers import BandFilter, CannyHough, Peer, PlanarFlow
from benchmarks.ftrace.scores import Found, Judged, figures, judge, together
from controllers.ftrace.estimator import Method, TraceAngle, TraceEstimator
from controllers.ftrace.parameters import DEFAULTS, FTraceParameters
from controllers.ground_motion.rig import RigFile
from drivers.clock import nanoseconds, stopwatch_ns
from drivers.samples import Image
from rover_hil.ftrace.overlay import draw
from tests.rear_scene.motion import RATE_HZ
from tests.rear_scene.rig_file import CalibratedRig
from tests.rear_scene.sequence import FrameSequence
from tests.rear_scene.sets import FIRST_HELD_OUT_SEED, SET_NAMES, make_sequence
from tests.rear_scene.truth import Telemetry, centre_line

METHODS: tuple[Method, ...] = get_args(Method)
PEERS: Mapping[str, Callable[[CalibratedRig], Peer]] = {
    "canny+hough": CannyHough,
    "flow": lambda rig: PlanarFlow(rig, gyro=False),
    "flow+gyro": lambda rig: PlanarFlow(rig, gyro=True),
    "band": BandFilter,
}
COLUMNS = {
    "missed_pct": "missed %",
    "longest_run": "run",
    "misidentified_pct": "misident. %",
    "false_pct": "false %",
    "hold_rms_deg": "rms hold",
    "chord_rms_deg": "rms chord",
    "path_rms_deg": "path chord",
    "roc": "ROC",
    "tracked_ms": "ms tracked",
    "cold_ms": "ms cold",
}
MOST = {
    "missed_pct": 2.0,
    "longest_run": 2.0,
    "misidentified_pct": 0.5,
    "false_pct": 0.3,
    "hold_rms_deg": 0.8,
    "path_rms_deg": 1.2,
    "tracked_ms": 4.0,
    "cold_ms": 10.0,
}
LEAST_ROC = 0.9
MOST_SPARSE = {"missed_pct": 5.0, "hold_rms_deg": 4.0}
PICTURES = 6
NEAR_M, LEAST_CHORD_M = 0.1, 0.15
"""Nearer to the contact the wheel hides the trace; shorter chords have no direction."""


def run(
    sequence: FrameSequence,
    images: Sequence[Image],
    method: Method,
    parameters: FTraceParameters = DEFAULTS,
) -> tuple[Found, list[TraceAngle]]:
    """Return the estimates of one of our methods on a drive."""
    rig = RigFile.model_validate(sequence.rig.as_json()).geometry()
    estimator = TraceEstimator(rig, method, parameters)
    angles, spent_ms = [], []
    for image, row in zip(images, sequence.telemetry, strict=True):
        start_ns = stopwatch_ns()
        angle = estimator.step(
            nanoseconds(row.t), image, wheel_speed_m_s=row.wheel_speed_mps, rates_rad_s=_rates(row)
        )
        spent_ms.append((stopwatch_ns() - start_ns) / 1e6)
        angles.append(angle)
    detected = np.array([angle.detected for angle in angles])
    result = Found(
        theta_deg=np.array([angle.theta_deg for angle in angles]),
        distance_m=np.array([_or_nan(angle.distance_m) for angle in angles]),
        path_off_deg=np.array([_path_off_deg(sequence, frame, angle) for frame, angle in enumerate(angles)]),
        confidence=np.array([angle.confidence for angle in angles]),
        detected=detected,
        tracked=np.r_[False, detected[:-1]],
        spent_ms=np.array(spent_ms),
        theta_sd_deg=np.degrees([_or_nan(angle.theta_sd_rad) for angle in angles]),
    )
    return result, angles


def run_peer(sequence: FrameSequence, images: Sequence[Image], peer: Peer) -> Found:
    """Return what a peer says of a drive; none has a confidence, or a state that could be lost."""
    rig = sequence.rig
    theta, left, spent_ms = [], [], []
    for image, row in zip(images, sequence.telemetry, strict=True):
        start_ns = stopwatch_ns()
        line = peer.look(image, math.radians(row.gyro_yaw_dps) / rig.fps)
        spent_ms.append((stopwatch_ns() - start_ns) / 1e6)
        theta.append(math.nan if line is None else line[0])
        left.append(math.nan if line is None else line[1])
    direction, steer = np.array(theta) + math.radians(rig.wheel.steer_deg), math.radians(rig.wheel.steer_deg)
    x, y = rig.wheel.x_m - np.array(left) * math.sin(steer), rig.wheel.y_m + np.array(left) * math.cos(steer)
    count = len(theta)
    return Found(
        theta_deg=np.degrees(theta),
        distance_m=y * np.cos(direction) - x * np.sin(direction),
        path_off_deg=np.full(count, np.nan),
        confidence=np.ones(count),
        detected=np.isfinite(theta),
        tracked=np.ones(count, np.bool_),
        spent_ms=np.array(spent_ms),
        theta_sd_deg=np.full(count, np.nan),
    )


def misses(name: str, table: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Return what misses a bar: of `fused`, in all sets together and where images are sparse."""
    sentences = []
    if name == "sparse":
        sentences = [_over(name, "fused", key, table, most) for key, most in MOST_SPARSE.items()]
    if name == "all":
        sentences = [_over(name, "fused", key, table, most) for key, most in MOST.items()]
        if "fused" in table and table["fused"]["roc"] < LEAST_ROC:
            sentences.append(f"{name} fused: roc {table['fused']['roc']:.2f} < {LEAST_ROC:g}")
    return [text for text in sentences if text]


def show(name: str, table: Mapping[str, Mapping[str, float]]) -> str:
    """Return a table in Markdown."""
    frames = int(next(iter(table.values()))["frames"])
    lines = [
        f"\n{name}, {frames} frames\n",
        f"| finder | {' | '.join(COLUMNS.values())} |",
        "|---" * (len(COLUMNS) + 1) + "|",
    ]
    for finder, values in table.items():
        cells = ["-" if math.isnan(values[key]) else f"{values[key]:.2f}" for key in COLUMNS]
        lines.append(f"| {finder} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def drive_through(
    sequence: FrameSequence, methods: Sequence[Method], with_peers: bool, pictures: Path | None
) -> dict[str, Judged]:
    """Render a drive and return how each finder does on it."""
    images = [np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8) for image in sequence.frames()]
    width_m = sequence.rig.wheel.width_m
    results: dict[str, Judged] = {}
    for method in methods:
        result, angles = run(sequence, images, method)
        results[method] = judge(result, sequence.truth, width_m)
        if pictures is not None and method == methods[-1]:
            _draw(pictures / f"{sequence.name}_{sequence.seed}.png", sequence, images, angles)
    for name, make in PEERS.items() if with_peers else ():
        results[name] = judge(run_peer(sequence, images, make(sequence.rig)), sequence.truth, width_m)
    return results


def main() -> int:
    """Run all; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--sets", default=",".join(SET_NAMES), help="names, with commas between")
    parser.add_argument("--seeds", type=int, default=1, help="drives per set")
    parser.add_argument("--first-seed", type=int, default=FIRST_HELD_OUT_SEED, help="below 1000: development")
    parser.add_argument("--seconds", type=float, help="length of each drive; its own where not given")
    parser.add_argument("--methods", default=",".join(METHODS), help="of ours, with commas between")
    parser.add_argument("--no-peers", action="store_true", help="leave the peers out")
    parser.add_argument("--pictures", type=Path, help="folder for frames with the trace drawn in")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    wanted = set(given.methods.split(","))
    methods = [method for method in METHODS if method in wanted]
    tables: dict[str, dict[str, dict[str, float]]] = {}
    pooled: dict[str, list[Judged]] = {}
    for name in (name for name in SET_NAMES if name in set(given.sets.split(","))):
        parts: dict[str, list[Judged]] = {}
        for seed in range(given.first_seed, given.first_seed + given.seeds):
            sequence = make_sequence(name, seed, given.seconds)
            for finder, judged in drive_through(
                sequence, methods, not given.no_peers, given.pictures
            ).items():
                parts.setdefault(finder, []).append(judged)
        _report(name, parts, tables)
        if name != "sparse":
            for finder, some in parts.items():
                pooled.setdefault(finder, []).extend(some)
    if pooled:
        _report("all", pooled, tables)
    missed = [text for name, table in tables.items() for text in misses(name, table)]
    sys.stdout.write(json.dumps({"missed": missed}, indent=2) + "\n")
    return 1 if missed else 0


def _report(
    name: str, parts: Mapping[str, Sequence[Judged]], tables: dict[str, dict[str, dict[str, float]]]
) -> None:
    tables[name] = {finder: figures(together(some)) for finder, some in parts.items()}
    sys.stdout.write(show(name, tables[name]))
    sys.stdout.flush()


def _over(name: str, finder: str, key: str, table: Mapping[str, Mapping[str, float]], most: float) -> str:
    value = table.get(finder, {}).get(key, math.nan)
    return f"{name} {finder}: {key} {value:.2f} > {most:g}" if value > most else ""


def _rates(row: Telemetry) -> tuple[float, float, float]:
    return (
        math.radians(row.gyro_roll_dps),
        math.radians(row.gyro_pitch_dps),
        math.radians(row.gyro_yaw_dps),
    )


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _path_off_deg(sequence: FrameSequence, frame: int, angle: TraceAngle) -> float:
    """Return the error of the path's chord against the true centre line's over the same stretch."""
    rig = sequence.rig
    true, _ = centre_line(rig, sequence.motion, round(sequence.truth[frame].t * RATE_HZ))
    true = true[np.isfinite(true[:, 0])]
    if len(angle.path_m) == 0 or len(true) == 0:
        return math.nan
    near, far = rig.wheel.x_m - NEAR_M, max(float(true[:, 0].min()), float(angle.path_m[:, 0].min()))
    if near - far < LEAST_CHORD_M:
        return math.nan
    both = [
        np.interp([far, near], line[order, 0], line[order, 1])
        for line in (angle.path_m, true)
        for order in [np.argsort(line[:, 0])]
    ]
    by_path, right = (math.atan2(y[1] - y[0], near - far) for y in both)
    return math.degrees(by_path - right)


def _draw(path: Path, sequence: FrameSequence, images: Sequence[Image], angles: Sequence[TraceAngle]) -> None:
    """Write a sheet of frames with what was found and what is true."""
    rig = RigFile.model_validate(sequence.rig.as_json()).geometry()
    shown = []
    for frame in np.linspace(0.1, 1.0, PICTURES) * (len(images) - 1):
        place = round(frame)
        picture = draw(images[place], angles[place], rig, sequence.rig.wheel.width_m)
        truth = sequence.truth[place]
        text = f"truth {truth.theta_t_deg:+.1f} deg, {truth.visible_m:.2f} m"
        cv2.putText(picture, text, (10, 470), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 2)
        shown.append(picture)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.vstack([np.hstack(shown[:3]), np.hstack(shown[3:])]))


if __name__ == "__main__":
    sys.exit(main())
