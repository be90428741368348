"""Settings of an NMEA 0183 compass."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from drivers.device_settings import SerialDeviceSettings
from drivers.driver import Codec
from drivers.settings import PathText


class NmeaCompassSettings(SerialDeviceSettings):
    """An NMEA 0183 compass, GNSS compass or attitude sensor.

    Attributes:
        max_age_s: The device counts as silent when its newest sample is older than this. The default fits a
            compass at 10 Hz; one lost sentence already exceeds it.
        require_checksum: Reject sentences without a checksum. A wrong checksum is always rejected.
        calibration: Path of a deviation table, a TOML file, applied to magnetic headings; from the
            configuration's folder.
    """

    data_file_keys = ("calibration",)

    type: Literal["nmea_compass"] = "nmea_compass"
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)] = 4800
    max_age_s: Annotated[float, Field(gt=0, le=10)] = 0.18
    require_checksum: bool = True
    calibration: PathText | None = None

    def data_files(self) -> Mapping[str, tuple[Path, ...]]:
        """Return the calibration file, if there is one."""
        return {} if self.calibration is None else {"calibration": (Path(self.calibration),)}

    def make_codec(self, name: str) -> Codec[bytes]:
        """Build the codec.

        Raises:
            ConfigError: The calibration file is missing or wrong.
        """
        from drivers.heading_calibration import DeviationTable, load_calibration
        from drivers.nmea_compass.codec import NmeaCompassCodec

        path = self.calibration
        table = None if path is None else load_calibration(Path(path), DeviationTable)
        return NmeaCompassCodec(name, require_checksum=self.require_checksum, deviation_table=table)
