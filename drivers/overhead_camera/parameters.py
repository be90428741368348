"""Values of the settings of an overhead camera; its codec reads them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from drivers.camera.parameters import FrameSourceParameters, Pixels
from drivers.settings import PathText

DICTIONARY_PATTERN = (
    r"^DICT_((4X4|5X5|6X6|7X7)_(50|100|250|1000)|ARUCO_ORIGINAL|ARUCO_MIP_36h12"
    r"|APRILTAG_(16h5|25h9|36h10|36h11))$"
)
"""The names of OpenCV's predefined dictionaries."""

SHIPPED_CALIBRATIONS = ("simulated",)

MarkerOffset = Annotated[float, Field(ge=-2, le=2)]


class OverheadCameraParameters(FrameSourceParameters):
    """A camera that looks down on the floor and on one ArUco or AprilTag marker on the rover.

    The marker is found in the loop's own thread, a few milliseconds per frame: keep `frame_rate_hz` low.

    Attributes:
        dictionary: Name of one of OpenCV's predefined dictionaries.
        marker_id: Number of the marker on the rover in that dictionary.
        marker_size_m: Side of the marker's black square.
        marker_height_m: Height of the marker above the plane of the calibration, usually the floor.
        marker_x_m: Position of the marker's centre, forward of the rover's origin.
        marker_y_m: Position of the marker's centre, to the left of the rover's origin.
        marker_yaw_deg: Direction of the marker's upper edge, from left to right as printed, counter-clockwise
            from forward.
        calibration: Path of the floor calibration, a TOML file (`FloorCalibration`), relative to the current
            directory; "simulated" is the shipped one of the simulated camera.
        latency_s: Age of an image at its arrival, where the camera gives no capture time.
        corner_noise_px: Standard deviation of each coordinate of a corner found in the image.
        position_noise_m: Standard deviation of the position from calibration and mounting.
        yaw_noise_deg: Standard deviation of the heading from calibration and mounting.
    """

    data_file_keys = ("calibration",)

    type: Literal["overhead_camera"]
    width: Pixels = 640
    height: Pixels = 480
    frame_rate_hz: Annotated[float, Field(gt=0, le=240)] = 2.0
    max_age_s: Annotated[float, Field(gt=0, le=10)] = 2.0
    dictionary: Annotated[str, Field(pattern=DICTIONARY_PATTERN)] = "DICT_4X4_50"
    marker_id: Annotated[int, Field(ge=0, le=2319)]
    marker_size_m: Annotated[float, Field(ge=0.01, le=1)]
    marker_height_m: Annotated[float, Field(ge=0, le=3)]
    marker_x_m: MarkerOffset = 0.0
    marker_y_m: MarkerOffset = 0.0
    marker_yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    calibration: PathText
    latency_s: Annotated[float, Field(ge=0, le=1)] = 0.05
    corner_noise_px: Annotated[float, Field(ge=0.01, le=5)] = 0.2
    position_noise_m: Annotated[float, Field(ge=0, le=0.1)] = 0.002
    yaw_noise_deg: Annotated[float, Field(ge=0, le=5)] = 0.2

    @property
    def calibration_file(self) -> Path:
        """Path of the calibration."""
        is_shipped = self.calibration in SHIPPED_CALIBRATIONS
        return Path(__file__).with_name(f"{self.calibration}.toml") if is_shipped else Path(self.calibration)

    def data_files(self) -> Mapping[str, tuple[Path, ...]]:
        """Return the calibration file."""
        return {"calibration": (self.calibration_file,)}
