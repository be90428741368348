"""`rover-hil calibrate camera`: a rig file from pictures of a calibration board."""

from pathlib import Path

import numpy as np
from rich.console import Console

from controllers.ftrace.rig import RigFile
from controllers.ftrace.rig_geometry import GroundPatch
from rover_hil.app.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.app.options import check_inputs
from rover_hil.ftrace.calibration import Board, GroundTarget, calibrate, rig_text
from rover_hil.pages.atomic_write import check_file, write_file

LARGEST_RMS_PX = 1.0


def calibrate_camera(
    pictures: Path,
    *,
    ground: Path,
    board: Board,
    target: GroundTarget,
    rover: Path,
    fps: float,
    out: Path,
    force: bool = False,
) -> int:
    """Write a rig file; returns the exit code: 1, and no file, when the board fits worse than 1 pixel.

    Raises:
        ConfigError: A file is wrong, `out` exists, or the camera does not see the ground behind the wheel.
    """
    check_file(out, force=force)
    check_inputs(pictures, ground, rover)
    found = calibrate(pictures, ground, board, target)
    text = rig_text(rover, found, fps)
    patch = GroundPatch(RigFile.model_validate_json(text).geometry())
    console = Console(highlight=False)
    x, y, z = found.position_m
    console.print(f"lens: {found.pictures} pictures, rms {found.lens_rms_px:.2f} px")
    console.print(f"pose: camera at {x:.3f}, {y:.3f}, {z:.3f} m, rms {found.ground_rms_px:.2f} px")
    console.print(f"ground behind the wheel in view: {100 * np.mean(patch.visible):.0f} %")
    if max(found.lens_rms_px, found.ground_rms_px) > LARGEST_RMS_PX:
        console.print(
            f"worse than {LARGEST_RMS_PX:g} px: not written; take sharper pictures, check the sizes"
        )
        return EXIT_NO
    write_file(out, text)
    return EXIT_OK
