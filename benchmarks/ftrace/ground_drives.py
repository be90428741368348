"""`fused` on drives of the renderer `tests/nature/ground_drives`, with planar flow and gyro beside it.

    python -m benchmarks.ftrace.ground_drives [--scenes bare_shadow,own_foliage] [--first-seed 100]
        [--seeds 1] [--frames 120] [--drives FOLDER]
    python -m benchmarks.ftrace.ground_drives --folders ../shared/data/trace_drives/shadow_104 ...

The renderer was written without knowledge of the estimator. Seeds from 100 are held out: nothing was tuned on
them. Prints the figures of every scene type and of all together, and how often the trace was right for each
range of the confidence. Definitions: `benchmarks/ftrace/scores.py`. With
`--drives`, rendered drives are kept in that folder and used again; with `--folders`, drives that are there
are judged and nothing is rendered. One seed of all scene types takes about
ten minutes on one core.
"""

import argparse
import csv
import math
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from benchmarks.ftrace.peers import PlanarFlow
from benchmarks.ftrace.scores import Floats, Found, Judged, figures, judge, together
from controllers.ftrace.estimator import TraceEstimator
from controllers.ground_motion.rig import RigFile
from drivers.clock import nanoseconds, stopwatch_ns
from drivers.samples import Image
from rover_hil.ftrace.telemetry import TelemetryRow, read_telemetry
from sim_backends.rear_scene.rig import Wheel
from tests.nature.ground_drives import SCENES, render
from tests.rear_scene.rig_file import CalibratedRig
from tests.rear_scene.truth import FrameTruth

FIRST_HELD_OUT_SEED = 100
COLUMNS = {
    "missed_pct": "missed %",
    "longest_run": "run",
    "long_missed_pct": "missed of 0.3 m, %",
    "long_run": "run of these",
    "within_pct": "within 2 sd, %",
    "hold_rms_deg": "hold with a trace, deg",
    "misidentified_pct": "misident. %",
    "false_pct": "false %",
    "roc": "ROC",
    "tracked_ms": "ms",
}
OTHER_COLUMNS = ("calibration", "ms, flow+gyro", "hold, deg", "hold, flow+gyro")
"""The error of the angle is of all frames, with a trace or without."""
BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0 + 1e-9)
UNKNOWN = dict.fromkeys(
    (
        "x_m", "y_m", "yaw_deg", "pitch_deg", "roll_deg", "rock_roll_deg", "rock_pitch_deg", "slip",
        "slip_angle_deg", "yaw_rate_dps", "line_deg", "chord_d_m",
    ),
    math.nan,
)  # fmt: skip

Finders = dict[str, list[Judged]]


def drive(folder: Path) -> dict[str, Judged]:
    """Return the judged frames of a rendered drive, by finder."""
    rig, telemetry, images = recorded(folder)
    angles = _flow(rig, images, telemetry)
    return {"fused": fused(folder), "flow+gyro": _judged(folder, rig, angles)}


def fused(folder: Path) -> Judged:
    """Return the judged frames of `fused` on a rendered drive."""
    rig, telemetry, images = recorded(folder)
    return _judged(folder, rig, found_in(rig, images, telemetry))


def recorded(folder: Path) -> tuple[RigFile, list[TelemetryRow], list[Image]]:
    """Return rig, telemetry and grey pictures of a rendered drive."""
    rig = RigFile.model_validate_json((folder / "rig.json").read_text("utf-8"))
    telemetry = list(read_telemetry(folder / "telemetry.csv").values())
    images = [
        np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)
        for path in sorted((folder / "frames").iterdir())
    ]
    return rig, telemetry, images


def _judged(folder: Path, rig: RigFile, angles: Found) -> Judged:
    return judge(angles, _truth(folder / "truth.csv"), rig.geometry().wheel_width_m)


def reliability(judged: Judged) -> list[tuple[float, float, int, float, float]]:
    """Return for each range of the confidence: its ends, frames, mean confidence, share that is right."""
    rows = []
    for low, high in pairwise(BINS):
        inside = (judged.confidence >= low) & (judged.confidence < high)
        count = int(inside.sum())
        mean, share = (
            (float(judged.confidence[inside].mean()), float(judged.right[inside].mean()))
            if count
            else (math.nan, math.nan)
        )
        rows.append((low, min(high, 1.0), count, mean, share))
    return rows


def calibration_error(judged: Judged) -> float:
    """Return the mean difference of confidence and share of right traces over the ranges, by frames."""
    rows = [row for row in reliability(judged) if row[2]]
    return sum(count * abs(mean - share) for _, _, count, mean, share in rows) / sum(row[2] for row in rows)


def main() -> int:
    """Run all; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scenes", default=",".join(SCENES), help="names, with commas between")
    parser.add_argument("--first-seed", type=int, default=FIRST_HELD_OUT_SEED, help="below 100: development")
    parser.add_argument("--seeds", type=int, default=1, help="drives per scene type")
    parser.add_argument("--frames", type=int, default=120, help="frames of each drive")
    parser.add_argument("--drives", type=Path, help="folder in which rendered drives are kept")
    parser.add_argument("--folders", type=Path, nargs="+", help="drives to judge instead of rendered ones")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    sys.stdout.write(f"| scene | {' | '.join(COLUMNS.values())} | {' | '.join(OTHER_COLUMNS)} |\n")
    sys.stdout.write("|---" * (len(COLUMNS) + len(OTHER_COLUMNS) + 1) + "|\n")
    everything: Finders = {}
    for folder in given.folders or ():
        here = {finder: [judged] for finder, judged in drive(folder).items()}
        _report(folder.name, here)
        for finder, some in here.items():
            everything.setdefault(finder, []).extend(some)
    with TemporaryDirectory() as temporary:
        kept = given.drives or Path(temporary)
        scenes = [] if given.folders else [scene for scene in SCENES if scene in given.scenes.split(",")]
        for scene in scenes:
            parts: Finders = {}
            for seed in range(given.first_seed, given.first_seed + given.seeds):
                folder = kept / f"{scene}_{seed}"
                if not folder.exists():
                    render(scene, seed, given.frames, folder)
                for finder, judged in drive(folder).items():
                    parts.setdefault(finder, []).append(judged)
            _report(scene, parts)
            for finder, some in parts.items():
                everything.setdefault(finder, []).extend(some)
    _report("all", everything)
    sys.stdout.write("\n| confidence | frames | mean | right |\n|---|---|---|---|\n")
    for low, high, count, mean, share in reliability(together(everything["fused"])):
        sys.stdout.write(f"| {low:.1f} to {high:.1f} | {count} | {mean:.2f} | {share:.2f} |\n")
    return 0


def _report(name: str, parts: Finders) -> None:
    ours, flow = together(parts["fused"]), figures(together(parts["flow+gyro"]))
    values = figures(ours)
    cells = [values[key] for key in COLUMNS]
    cells += [
        calibration_error(ours),
        flow["tracked_ms"],
        *(_rms(judged.hold_deg) for judged in (ours, together(parts["flow+gyro"]))),
    ]
    text = " | ".join("-" if math.isnan(cell) else f"{cell:.2f}" for cell in cells)
    sys.stdout.write(f"| {name} | {text} |\n")
    sys.stdout.flush()


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def found_in(rig: RigFile, images: Sequence[Image], telemetry: Sequence[TelemetryRow]) -> Found:
    """Return what `fused` finds in the frames of a drive."""
    estimator = TraceEstimator(rig.geometry())
    angles, spent_ms = [], []
    for image, row in zip(images, telemetry, strict=True):
        start_ns = stopwatch_ns()
        angle = estimator.step(
            nanoseconds(row.t_s), image, wheel_speed_m_s=row.wheel_speed_m_s, rates_rad_s=row.rates_rad_s
        )
        spent_ms.append((stopwatch_ns() - start_ns) / 1e6)
        angles.append(angle)
    detected = np.array([angle.detected for angle in angles])
    return Found(
        theta_deg=np.array([angle.theta_deg for angle in angles]),
        distance_m=np.array([math.nan if a.distance_m is None else a.distance_m for a in angles]),
        path_off_deg=np.full(len(angles), np.nan),
        confidence=np.array([angle.confidence for angle in angles]),
        detected=detected,
        tracked=np.r_[False, detected[:-1]],
        spent_ms=np.array(spent_ms),
        theta_sd_deg=np.array(
            [math.nan if a.theta_sd_rad is None else math.degrees(a.theta_sd_rad) for a in angles]
        ),
    )


def _flow(rig: RigFile, images: Sequence[Image], telemetry: Sequence[TelemetryRow]) -> Found:
    peer = PlanarFlow(_peer_rig(rig), gyro=True)
    theta, spent_ms, before_s = [], [], telemetry[0].t_s
    for image, row in zip(images, telemetry, strict=True):
        yaw_rad_s = 0.0 if row.rates_rad_s is None else row.rates_rad_s[2]
        start_ns = stopwatch_ns()
        line = peer.look(image, yaw_rad_s * (row.t_s - before_s))
        spent_ms.append((stopwatch_ns() - start_ns) / 1e6)
        before_s = row.t_s
        theta.append(math.nan if line is None else math.degrees(line[0]))
    count = len(theta)
    return Found(
        theta_deg=np.array(theta),
        distance_m=np.full(count, np.nan),
        path_off_deg=np.full(count, np.nan),
        confidence=np.ones(count),
        detected=np.isfinite(theta),
        tracked=np.ones(count, np.bool_),
        spent_ms=np.array(spent_ms),
        theta_sd_deg=np.full(count, np.nan),
    )


def _peer_rig(rig: RigFile) -> CalibratedRig:
    """Return the rig as the peers take it."""
    assert rig.wheel is not None
    x, y, _ = rig.wheel.contact_point
    wheel = Wheel(
        name=rig.wheel.name,
        x_m=x,
        y_m=y,
        radius_m=rig.wheel.radius_m,
        width_m=rig.wheel.width_m,
        grouser_height_m=rig.wheel.grouser_height_m,
        lug_count=rig.wheel.lug_count,
        steer_deg=rig.wheel.steer_deg,
    )
    return CalibratedRig(
        width=rig.image.width,
        height=rig.image.height,
        fps=rig.image.fps,
        camera_matrix=np.array(rig.camera_matrix),
        distortion=np.array(rig.dist_coeffs.values),
        vehicle_from_camera=np.array(rig.R_vehicle_camera),
        camera_m=np.array(rig.t_vehicle_camera),
        wheel=wheel,
        other_wheels=(),
        b_m=rig.b_m,
    )


def _truth(path: Path) -> list[FrameTruth]:
    """Return the truth as the scores take it; what they do not read is NaN."""
    with path.open(encoding="utf-8", newline="") as file:
        return [
            FrameTruth(
                frame=int(row["frame"]),
                t=float(row["t"]),
                theta_t_deg=float(row["theta_t_deg"]),
                d_t_m=float(row["d_t_m"]),
                chord_deg=float(row["theta_chord_deg"]),
                visible_m=float(row["visible_len_m"]),
                trace_present=row["present"] == "1",
                usable=True,
                **UNKNOWN,
            )
            for row in csv.DictReader(file)
        ]


if __name__ == "__main__":
    sys.exit(main())
