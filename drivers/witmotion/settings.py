"""Settings of a WitMotion sensor."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from drivers.driver import Codec
from drivers.inertial_settings import InertialSettings
from drivers.settings import PathText


class WitMotionSettings(InertialSettings):
    """A WitMotion inertial sensor; by default its z axis points up.

    Attributes:
        baud_rate: Line speed; the device leaves the factory at 9600 bit/s, which is too slow for 50 Hz.
        yaw_zero_deg: Direction of the sensor's x axis, counter-clockwise from magnetic east, when it reports
            yaw 0. The data sheets name an east-north-up frame, hence 0; check it against a known direction.
        calibration: Path of a TOML file with hard and soft iron, from the configuration's folder. With it
            the heading is computed from the raw magnetic field (frame 0x54, which the device must be set to
            send) instead of the device's yaw.
    """

    data_file_keys = ("calibration",)

    type: Literal["witmotion"] = "witmotion"
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)] = 115_200
    yaw_zero_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    calibration: PathText | None = None

    def data_files(self) -> Mapping[str, tuple[Path, ...]]:
        """Return the calibration file, if there is one."""
        return {} if self.calibration is None else {"calibration": (Path(self.calibration),)}

    def make_codec(self, name: str) -> Codec[bytes]:
        """Build the codec.

        Raises:
            ConfigError: The calibration file is missing or wrong.
        """
        from drivers.heading_calibration import MagnetometerCalibration, load_calibration
        from drivers.witmotion.codec import WitMotionCodec

        mounting = self.make_mounting(self.yaw_zero_deg)
        if self.calibration is None:
            return WitMotionCodec(name, mounting)
        return WitMotionCodec(
            name, mounting, load_calibration(Path(self.calibration), MagnetometerCalibration)
        )
