"""`rover-hil ground`: motion over the ground and slip in the frames of a camera."""

import math
import re
from collections import Counter
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import cv2
import typer

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import GroundView
from drivers.camera.images import NO_PIXELS
from drivers.errors import ConfigError
from drivers.samples import Image
from rover_hil.console.exit_codes import EXIT_INTERRUPTED, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ForceOption, JsonOption, RigOption, check_inputs, out_option
from rover_hil.console.steps import show_progress
from rover_hil.ftrace.inputs import read_inputs
from rover_hil.ftrace.log_frames import LogFrames
from rover_hil.ftrace.overlay import OverlayWriter
from rover_hil.ground.picture import draw
from rover_hil.ground.run import HEADER, FrameMotion, csv_row, measure
from rover_hil.pages.atomic_write import check_file, refuse_overwrite, unfinished, write_file
from rover_hil.terminal import Terminal

NUMBER = r"[-+]?\d+(\.\d+)?"


def ground_motion(
    frames: Annotated[
        Path,
        typer.Argument(help="A folder of pictures, a video, or a log of a rover with a camera (.mcap)."),
    ],
    *,
    out: Annotated[Path, out_option("CSV file to write: one row per frame. A picture is written beside it.")],
    rig_path: RigOption = None,
    telemetry_path: Annotated[
        Path | None,
        typer.Option(
            "--telemetry",
            help="CSV file: frame, t, wheel speed, gyro; see docs/reference/ftrace_files.md. A log holds its "
            "own. Without wheel speeds there is no slip, and ground that stands cannot be distinguished from "
            "what is fixed in the picture.",
        ),
    ] = None,
    overlay: Annotated[
        Path | None,
        typer.Option(
            help="Also draw every frame from above with its points: a video (.mp4, .avi) or a folder."
        ),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Measure the motion over the ground, and the slip of the wheels, in the frames of a camera.

    Example: `rover-hil ground frames/ --rig rig.json --telemetry telemetry.csv --out motion.csv`, or of a
    log: `rover-hil ground runs/sand/run.mcap --out motion.csv`

    Writes the motion of each frame with its standard deviation, or why it is not valid, and a picture of the
    last frame that was measured: from above, with the points that follow the ground and what is fixed in the
    picture. The columns t, x_m, y_m and yaw_rad can be imported with `rover-hil import table`.

    Data: `rover-hil sample frames` writes the files, `rover-hil sample sand` the log; of your own:
    docs/how-to/measure_the_ground_motion.md.
    """
    check_file(out, force=force)
    picture_path = out.with_suffix(".png")
    if picture_path == out:
        raise ConfigError(
            f"--out {out} is the name of the picture beside the table: choose another, like .csv"
        )
    check_file(picture_path, force=force)
    if overlay is not None:
        refuse_overwrite(overlay, force=force, option="--overlay")
    check_inputs(frames)
    inputs = read_inputs(frames, rig_path, telemetry_path)
    log = inputs.source if isinstance(inputs.source, LogFrames) else None
    ground = None if log is None else log.ground
    if ground is not None and rig_path is None:
        inputs = inputs._replace(rig=ground.rig)
    view = GroundView(GroundPatch(inputs.rig.geometry()))
    estimator = GroundMotionEstimator(
        view, inputs.tolerance, rotates_about_origin=log is None or not log.skids_in_rotations
    )
    items: list[FrameMotion] = []
    picture: Image | None = None
    code = EXIT_OK
    with ExitStack() as resources:
        part = None if overlay is None else resources.enter_context(unfinished(overlay, option="--overlay"))
        writer: OverlayWriter | None = None
        try:
            with show_progress() as progress:
                task = progress.add_task("frames", total=inputs.source.count)
                for item in measure(inputs, estimator):
                    is_last = len(items) + 1 == inputs.source.count
                    if part is not None or picture is None or is_last or estimator.pair is not None:
                        drawn = draw(item.grey, view, estimator, _title(item))
                        picture = drawn if picture is None or estimator.pair is not None else picture
                    if part is not None:
                        if writer is None:
                            size = (drawn.shape[1], drawn.shape[0])
                            writer = OverlayWriter(part, size, inputs.rig.image.fps)
                            resources.enter_context(closing(writer))
                        writer.add(item.number, drawn)
                    items.append(replace(item, grey=NO_PIXELS))
                    progress.advance(task)
        except KeyboardInterrupt:
            code = EXIT_INTERRUPTED
        write_file(out, "\n".join([HEADER, *map(csv_row, items)]) + "\n")
        if picture is not None:
            _write_picture(picture_path, picture)
    _report(items, out, picture_path, as_json=as_json)
    return code


def _write_picture(path: Path, picture: Image) -> None:
    is_written, data = cv2.imencode(".png", picture)
    if not is_written:
        raise ConfigError(f"{path} cannot be written: choose another --out")
    path.write_bytes(data.tobytes())


def _title(item: FrameMotion) -> str:
    motion = item.motion
    if motion is None:
        return f"frame {item.number}: first"
    if not motion.is_valid:
        return f"frame {item.number}: not valid: {motion.invalid_because}"
    slip = "" if item.slip is None else f", slip {item.slip[0]:.2f} +- {item.slip[1]:.2f}"
    return (
        f"frame {item.number}: {1e3 * motion.forward_m:.1f} mm ahead, {1e3 * motion.left_m:.1f} mm left, "
        f"{math.degrees(motion.turn_rad):.2f} deg{slip}"
    )


def _report(items: list[FrameMotion], out: Path, picture: Path, *, as_json: bool) -> None:
    """Print a summary."""
    motions = [item for item in items if item.motion is not None]
    valid = [item for item in motions if item.motion is not None and item.motion.is_valid]
    ahead_m = sum(item.motion.forward_m for item in valid if item.motion is not None)
    wheels = [item.wheel_m for item in valid if item.wheel_m is not None]
    wheel_m = sum(wheels) if len(wheels) == len(valid) and wheels else None
    slip = 1.0 - ahead_m / wheel_m if wheel_m else None
    invalid = [each.motion.invalid_because for each in motions if each.motion and not each.motion.is_valid]
    # Reasons that differ in their numbers only are one; the newest numbers are shown.
    texts = {re.sub(NUMBER, "", reason): reason for reason in invalid}
    counts = Counter(re.sub(NUMBER, "", reason) for reason in invalid)
    reasons = Counter({texts[key]: count for key, count in counts.items()})
    if as_json:
        print_json(
            {
                "frames": len(items),
                "pairs": len(motions),
                "valid": len(valid),
                "forward_m": ahead_m,
                "wheel_travel_m": wheel_m,
                "slip": slip,
                "not_valid": dict(reasons),
            }
        )
        return
    terminal = Terminal(soft_wrap=True)
    wheel_words = "" if wheel_m is None else f", {wheel_m:.3f} m by the wheels"
    slip_words = "" if slip is None else f": slip {slip:.3f}"
    terminal.print(
        f"motion valid in {len(valid)} of {len(motions)} pairs of frames: {ahead_m:.3f} m ahead"
        f"{wheel_words}{slip_words}; {out}, {picture}"
    )
    for reason, count in reasons.most_common(3):
        terminal.print(f"not valid in {count}: {reason}")
