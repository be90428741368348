"""`rover-hil ftrace`: slip angle of every frame from the trace of a wheel."""

import math
import sys
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated, get_args

import numpy as np
import typer

from controllers.ftrace.estimator import Method, TraceEstimator
from drivers.camera.images import NO_PIXELS
from drivers.errors import ConfigError
from rover_hil.console.exit_codes import EXIT_INTERRUPTED, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ForceOption, JsonOption, RigOption, check_inputs, out_option
from rover_hil.console.steps import show_progress
from rover_hil.ftrace.inputs import read_inputs
from rover_hil.ftrace.overlay import OverlayWriter, draw
from rover_hil.ftrace.run import HEADER, FrameAngle, csv_row, estimate, longest_gap
from rover_hil.pages.atomic_write import check_file, refuse_overwrite, unfinished, write_file
from rover_hil.terminal import Terminal

METHODS: tuple[Method, ...] = get_args(Method)


def trace_angles(
    frames: Annotated[
        Path,
        typer.Argument(help="A folder of pictures, a video, or a log of a rover with a rear camera (.mcap)."),
    ],
    *,
    out: Annotated[Path, out_option("CSV file to write: one row per frame.")],
    rig_path: RigOption = None,
    telemetry_path: Annotated[
        Path | None,
        typer.Option(
            "--telemetry",
            help="CSV file: frame, t, wheel speed, compass, gyro; see docs/reference/ftrace_files.md. A log "
            "holds its own.",
        ),
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(help="Also draw the trace: a video (.mp4, .avi) or a folder.")
    ] = None,
    method: Annotated[
        str,
        typer.Option(help="`fused`, the best one, or `hough`, the paper's.", metavar="[fused|hough]"),
    ] = "fused",
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Measure the slip angle from the trace that a rear wheel leaves, seen by a rearward camera.

    Example: `rover-hil ftrace frames/ --rig rig.json --telemetry telemetry.csv --out angles.csv`, or of a
    log: `rover-hil ftrace runs/sand/run.mcap --out angles.csv`

    Data: `rover-hil sample frames` writes the files, `rover-hil sample sand` the log; of your own:
    docs/how-to/measure_a_wheel_trace.md.
    """
    chosen = _method(method)
    check_file(out, force=force)
    if overlay is not None:
        refuse_overwrite(overlay, force=force, option="--overlay")
    check_inputs(frames)
    inputs = read_inputs(frames, rig_path, telemetry_path)
    geometry = inputs.rig.geometry()
    estimator = TraceEstimator(geometry, chosen, tolerance=inputs.tolerance)
    angles: list[FrameAngle] = []
    code = EXIT_OK
    with ExitStack() as resources:
        writer = None
        if overlay is not None:
            part = resources.enter_context(unfinished(overlay, option="--overlay"))
            writer = resources.enter_context(
                closing(OverlayWriter(part, (geometry.width, geometry.height), inputs.rig.image.fps))
            )
        try:
            with show_progress() as progress:
                task = progress.add_task("frames", total=inputs.source.count)
                for item in estimate(inputs, estimator):
                    if writer is not None:
                        writer.add(item.number, draw(item.grey, item.angle, geometry, geometry.wheel_width_m))
                    angles.append(replace(item, grey=NO_PIXELS))
                    progress.advance(task)
        except KeyboardInterrupt:
            code = EXIT_INTERRUPTED
        write_file(out, "\n".join([HEADER, *map(csv_row, angles)]) + "\n")
    _report(angles, out, chosen, as_json=as_json)
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
    raise ConfigError(f"--method {name}{removed}: use fused, or hough for the method of the paper")


NO_MOTION = (
    "note: in no frame does the ground move as the wheels do: is the camera turned against the rig file, "
    "covered, too dark or too bright, or was the rover at rest or stuck?"
)


def _report(angles: list[FrameAngle], out: Path, method: Method, *, as_json: bool) -> None:
    """Print a summary."""
    detected = [item.angle.detected for item in angles]
    degrees = [item.angle.theta_deg for item in angles if item.angle.detected]
    by_flow = sum(item.angle.source == "flow" for item in angles)
    contradictions = [item for item in angles if item.angle.contradiction]
    contradiction = contradictions[0].angle.contradiction if contradictions else ""
    mounting_deg = math.degrees(angles[-1].angle.mounting_sd_rad or 0.0) if angles else 0.0
    if as_json:
        summary = {
            "frames": len(angles),
            "detected": len(degrees),
            "longest_gap_frames": longest_gap(detected),
            "mean_theta_t_deg": float(np.mean(degrees)) if degrees else None,
            "method": method,
            "by_flow": by_flow,
            "mounting_sd_deg": mounting_deg or None,
            "contradiction": contradiction,
        }
        print_json(summary)
        return
    mean = f", mean angle {np.mean(degrees):+.1f} deg" if degrees else ""
    Terminal(soft_wrap=True).print(
        f"trace in {len(degrees)} of {len(angles)} frames{mean}; "
        f"angle without a trace, by the motion of the ground, in {by_flow}; {out}"
    )
    if contradictions:
        count, first_s = len(contradictions), contradictions[0].t_s
        Terminal(soft_wrap=True).print(f"no angle in {count} frames, from {first_s:g} s on: {contradiction}")
    elif method == "fused" and not degrees and not by_flow:
        Terminal(soft_wrap=True).print(NO_MOTION)
    elif mounting_deg:
        Terminal(soft_wrap=True).print(
            f"all angles share the yaw of the camera's mounting, known to {mounting_deg:.2g} deg: "
            "travel on several headings checks it"
        )
