"""`rover-hil calibrate camera`: a rig file from pictures of a calibration board."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.rig import RigFile
from rover_hil.config import Config
from rover_hil.console.options import check_inputs, number_option, out_option
from rover_hil.pages.picture import Drawing
from rover_hil.ready.camera.figures import draw_coverage, draw_errors
from rover_hil.ready.camera.fit import Board, Calibration, GroundTarget, fit_camera, rig_text
from rover_hil.ready.options import command
from rover_hil.ready.procedure import Entry, Facts, FileProcedure, Request

LARGEST_RMS_PX = 1.0


@command()
def calibrate(
    source: Annotated[
        str, typer.Argument(help="Folder, video or log of the board in many poses.", metavar="PICTURES")
    ],
    ground: Annotated[
        Path,
        typer.Option(help="Picture of the board on the ground behind the wheel, or a log: its last frame."),
    ],
    rover: Annotated[Path, typer.Option(help="JSON with the rig's keys that are not the camera's.")],
    out: Annotated[Path, out_option("Rig file to write, JSON; the page beside it has its name.")],
    columns: Annotated[int, number_option("Squares along the board's x axis.", "squares", 3, 100)],
    rows: Annotated[int, number_option("Squares along its y axis.", "squares", 3, 100)],
    square: Annotated[float, number_option("Side of a square, m.", "m", 0.001, 1.0)],
    ground_x: Annotated[
        float, number_option("First inner corner on the ground, vehicle frame, m.", "m", -100.0, 100.0)
    ],
    ground_y: Annotated[
        float, number_option("First inner corner on the ground, vehicle frame, m.", "m", -100.0, 100.0)
    ],
    ground_yaw: Annotated[
        float, number_option("Direction of the board's columns from x, deg.", "deg", -360.0, 360.0)
    ] = 0.0,
    board: Annotated[Literal["chessboard", "charuco"], typer.Option(help="The printed board.")] = "charuco",
    fps: Annotated[float, number_option("Frames per second.", "Hz", 0.01, 1000.0)] = 5.0,
) -> "CameraCalibration":
    """Make the rig file of a rearward camera: lens, and pose above the ground.

    The page with the picture is written before the file. Exit code 1: the board fits worse than 1 pixel; the
    file is not written.

    Example: `rover-hil calibrate camera pictures/ --ground ground.png --rover rover.json --out my_rig.json
    --columns 8 --rows 6 --square 0.04 --ground-x -0.72 --ground-y 0.1 --ground-yaw 90`

    Data: `rover-hil sample board` writes these files; for pictures by your camera and rover.json,
    docs/how-to/measure_a_wheel_trace.md describes them.
    """
    return CameraCalibration(
        ground,
        rover,
        Board(kind=board, columns=columns, rows=rows, square_m=square),
        GroundTarget(x_m=ground_x, y_m=ground_y, yaw_rad=radians(ground_yaw)),
        fps,
    )


@dataclass(frozen=True, slots=True)
class CameraRig:
    """A calibration as the text of a rig file, and how much of the ground behind the wheel is in view."""

    calibration: Calibration
    text: str
    visible: float

    @property
    def problem(self) -> str:
        """Why the file must not be used; empty where it may."""
        if max(self.calibration.lens_rms_px, self.calibration.ground.rms_px) > LARGEST_RMS_PX:
            return f"worse than {LARGEST_RMS_PX:g} px: take sharper pictures, check the sizes"
        return ""


@dataclass
class CameraCalibration(FileProcedure[Calibration, CameraRig]):
    """Lens and pose of a camera.

    Attributes:
        ground: Picture of the board on the ground, or a log, whose last frame is taken.
        rover: JSON with the rig's keys that are not the camera's.
        board: The board.
        target: Its place on the ground.
        fps: Frames per second.
    """

    takes_config = False

    ground: Path
    rover: Path
    board: Board
    target: GroundTarget
    fps: float

    def configure(self, request: Request, config: Config | None) -> Path | None:
        return request.out

    def read(self, logs: Sequence[Path]) -> Calibration:
        """Return lens and pose by the pictures of a folder, video or log.

        Raises:
            ConfigError: A picture or key is wrong.
            LogError: An input is missing.
        """
        check_inputs(logs[0], self.ground, self.rover)
        return fit_camera(logs[0], self.ground, self.board, self.target)

    def fit(self, record: Calibration) -> CameraRig:
        """Return the rig.

        Raises:
            ConfigError: A key of the rig is wrong, or the camera does not see the ground behind the wheel.
        """
        text = rig_text(self.rover, record, self.fps)
        patch = GroundPatch(RigFile.model_validate_json(text).geometry())
        return CameraRig(record, text, float(np.mean(patch.visible)))

    def title(self, record: Calibration, result: CameraRig) -> str:
        return f"Camera: not calibrated, {result.problem}" if result.problem else "Camera: lens and pose"

    def facts(self, record: Calibration, result: CameraRig) -> Facts:
        x, y, z = record.position_m
        return (
            ("lens", f"{len(record.views)} pictures, rms {record.lens_rms_px:.2f} px"),
            ("pose", f"camera at {x:.3f}, {y:.3f}, {z:.3f} m, rms {record.ground.rms_px:.2f} px"),
            ("ground behind the wheel in view", f"{100 * result.visible:.0f} %"),
        )

    def figures(self, record: Calibration, result: CameraRig) -> Sequence[Drawing]:
        return (
            Drawing(
                "Where the board was seen",
                "See whether the blue dots cover the view into its corners: the lens is not known elsewhere.",
                lambda: draw_coverage(record),
            ),
            Drawing(
                "What the calibration misses",
                "See whether the dots on the left lie around zero without a pattern. Leave out a picture "
                "that is much worse than the others on the right.",
                lambda: draw_errors(record, LARGEST_RMS_PX),
            ),
        )

    def write(self, record: Calibration, result: CameraRig) -> str:
        return result.text

    def entries(self, record: Calibration, result: CameraRig, out: Path | None) -> Sequence[Entry]:
        return (Entry("scomp", "rig", str(out)),)
