"""`rover-hil ftrace`: slip angle of every frame from the trace of a wheel."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
from rich.console import Console
from rich.progress import Progress

from controllers.ftrace.estimator import Method, TraceEstimator
from drivers.camera.images import NO_PIXELS
from drivers.errors import ConfigError
from rover_hil.config import read_rig
from rover_hil.ftrace.frames import FrameSource
from rover_hil.ftrace.overlay import OverlayWriter
from rover_hil.ftrace.run import FrameAngle, csv_row, estimate, longest_gap, write_csv
from rover_hil.ftrace.telemetry import read_telemetry

METHODS: tuple[Method, ...] = get_args(Method)
EXIT_OK = 0
EXIT_INTERRUPTED = 130


def trace_angles(
    frames: Path,
    *,
    rig_path: Path,
    telemetry_path: Path | None,
    out: Path,
    overlay: Path | None,
    method: str,
    as_json: bool,
) -> int:
    """Write the angle of every frame; returns the exit code: 130 when interrupted, the frames so far written.

    Args:
        frames: Folder of pictures, or a video.
        rig_path: Rig file, JSON.
        telemetry_path: CSV file with a row for each frame, or None.
        out: CSV file to write.
        overlay: Video or folder for pictures, or None.
        method: `fused` or `hough`; `ftrace`, the old name of `hough`, is accepted with a note.
        as_json: Print a summary as JSON.

    Raises:
        ConfigError: The method is unknown, a file is invalid, or the frames do not fit the rig.
    """
    chosen = _method(method)
    rig = read_rig(rig_path)
    geometry = rig.geometry()
    source = FrameSource(frames)
    telemetry = None if telemetry_path is None else read_telemetry(telemetry_path)
    estimator = TraceEstimator(geometry, chosen)
    writer = None if overlay is None else OverlayWriter(overlay, geometry, rig.image.fps)
    found: list[FrameAngle] = []
    code = EXIT_OK
    try:
        with Progress(console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task("frames", total=source.count)
            for item in estimate(source, rig, telemetry, estimator):
                if writer is not None:
                    writer.add(item.number, item.grey, item.angle, rig.wheel.width_m)
                found.append(replace(item, grey=NO_PIXELS))
                progress.advance(task)
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    except ConfigError:
        if writer is not None:
            writer.discard()
        raise
    write_csv(out, [csv_row(item) for item in found])
    if writer is not None:
        writer.close()
    _report(found, out, chosen, as_json=as_json)
    return code


def _method(name: str) -> Method:
    """Return the method of a name.

    Raises:
        ConfigError: There is no such method.
    """
    if name == "ftrace":
        note = "--method ftrace is now called hough: the next version knows the new name only"
        print(note, file=sys.stderr)  # noqa: T201 - a note to the user
        return "hough"
    for method in METHODS:
        if method == name:
            return method
    removed = " was removed, it was a part of fused" if name in ("rut", "memory") else " is unknown"
    msg = f"--method {name}{removed}: use fused, or hough for the method of the paper"
    raise ConfigError(msg)


def _report(found: list[FrameAngle], out: Path, method: Method, *, as_json: bool) -> None:
    """Print a summary."""
    detected = [item.angle.detected for item in found]
    degrees = [item.angle.theta_deg for item in found if item.angle.detected]
    if as_json:
        summary = {
            "frames": len(found),
            "detected": len(degrees),
            "longest_gap_frames": longest_gap(detected),
            "mean_theta_t_deg": float(np.mean(degrees)) if degrees else None,
            "method": method,
        }
        print(json.dumps(summary))  # noqa: T201
        return
    mean = f", mean angle {np.mean(degrees):+.1f} deg" if degrees else ""
    Console(highlight=False, soft_wrap=True).print(
        f"trace in {len(degrees)} of {len(found)} frames{mean}; {out}"
    )
