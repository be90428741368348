"""`rover-hil ftrace`: slip angle of every frame from the trace of a wheel."""

import json
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from controllers.ftrace.estimator import Method, TraceEstimator, TraceSettings
from rover_hil.trace.frames import FrameSource
from rover_hil.trace.overlay import OverlayWriter
from rover_hil.trace.rig_file import read_rig
from rover_hil.trace.run import csv_row, estimate, longest_gap, write_csv
from rover_hil.trace.telemetry import read_telemetry

EXIT_OK = 0


def trace_angles(
    frames: Path,
    *,
    rig_path: Path,
    telemetry_path: Path | None,
    out: Path,
    overlay: Path | None,
    method: Method,
    as_json: bool,
) -> int:
    """Write the angle of every frame; returns the exit code.

    Args:
        frames: Folder of pictures, or a video.
        rig_path: Rig file, JSON.
        telemetry_path: CSV file with a row for each frame, or None.
        out: CSV file to write.
        overlay: Video or folder for pictures, or None.
        method: How the trace is looked for.
        as_json: Print a summary as JSON.

    Raises:
        ConfigError: A file is wrong, or the frames do not fit the rig.
    """
    rig = read_rig(rig_path)
    geometry = rig.geometry()
    source = FrameSource(frames)
    telemetry = None if telemetry_path is None else read_telemetry(telemetry_path)
    estimator = TraceEstimator(geometry, TraceSettings(method=method))
    writer = None if overlay is None else OverlayWriter(overlay, geometry, rig.image.fps)
    rows: list[str] = []
    found: list[bool] = []
    degrees: list[float] = []
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("frames", total=source.count)
        for item in estimate(source, rig, telemetry, estimator):
            rows.append(csv_row(item))
            found.append(item.angle.detected)
            if item.angle.detected and item.angle.theta_rad is not None:
                degrees.append(float(np.degrees(item.angle.theta_rad)))
            if writer is not None:
                writer.add(item.number, item.grey, item.angle, rig.wheel.width_m)
            progress.advance(task)
    write_csv(out, rows)
    if writer is not None:
        writer.close()
    summary = {
        "frames": len(rows),
        "detected": len(degrees),
        "longest_gap_frames": longest_gap(found),
        "mean_theta_t_deg": float(np.mean(degrees)) if degrees else None,
        "method": method,
    }
    if as_json:
        print(json.dumps(summary))  # noqa: T201
    else:
        mean = f", mean angle {np.mean(degrees):+.1f} deg" if degrees else ""
        Console(highlight=False).print(f"trace in {len(degrees)} of {len(rows)} frames{mean}; {out}")
    return EXIT_OK
