"""`rover-hil calibrate camera`: a rig file from pictures of a calibration board."""

from pathlib import Path

import numpy as np

from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.rig import RigFile
from rover_hil.app.calibrate.results import check_results
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.options import check_inputs
from rover_hil.console.steps import show_steps
from rover_hil.ftrace.calibration import Board, Calibration, GroundTarget, calibrate, rig_text
from rover_hil.ftrace.calibration_figures import draw_coverage, draw_errors
from rover_hil.pages.atomic_write import write_file
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.terminal import Terminal

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

    The page with the picture is written first, also where the board does not fit.

    Raises:
        ConfigError: A file is wrong, `out` exists, or the camera does not see the ground behind the wheel.
        LogError: An input is missing, or a log is damaged or holds no frames.
    """
    page = check_results(out, force=force)
    check_inputs(pictures, ground, rover)
    with show_steps(f"looking for the board in {pictures}"):
        found = calibrate(pictures, ground, board, target)
    text = rig_text(rover, found, fps)
    patch = GroundPatch(RigFile.model_validate_json(text).geometry())
    x, y, z = found.position_m
    facts = (
        ("lens", f"{len(found.views)} pictures, rms {found.lens_rms_px:.2f} px"),
        ("pose", f"camera at {x:.3f}, {y:.3f}, {z:.3f} m, rms {found.ground.rms_px:.2f} px"),
        ("ground behind the wheel in view", f"{100 * np.mean(patch.visible):.0f} %"),
    )
    problem = ""
    if max(found.lens_rms_px, found.ground.rms_px) > LARGEST_RMS_PX:
        problem = f"worse than {LARGEST_RMS_PX:g} px: take sharper pictures, check the sizes"
    write_file(page, _page(found, facts, problem))
    console = Terminal(soft_wrap=True)
    for name, value in facts:
        console.print(f"{name}: {value}")
    console.print(f"picture: {page}")
    if problem:
        console.print(f"not written: {problem}")
        return EXIT_NO
    write_file(out, text)
    console.print(f'written to {out}; in the configuration: [scomp] rig = "{out}"')
    return EXIT_OK


def _page(found: Calibration, facts: tuple[tuple[str, str], ...], problem: str) -> str:
    drawings = [
        Drawing(
            "Where the board was seen",
            "See whether the blue dots cover the view into its corners: the lens is not known elsewhere.",
            lambda: draw_coverage(found),
        ),
        Drawing(
            "What the calibration misses",
            "See whether the dots on the left lie around zero without a pattern. Leave out a picture that is "
            "much worse than the others on the right.",
            lambda: draw_errors(found, LARGEST_RMS_PX),
        ),
    ]
    return render(
        "identify/report.html",
        grade="attention" if problem else "plain",
        title=f"Camera: not calibrated, {problem}" if problem else "Camera: lens and pose",
        facts=facts,
        pictures=draw_pictures(drawings),
    )
