"""Settings of an overhead camera."""

from drivers.camera.settings import FrameSourceSettings
from drivers.driver import Codec
from drivers.link import CameraImage
from drivers.overhead_camera.parameters import OverheadCameraParameters


class OverheadCameraSettings(OverheadCameraParameters, FrameSourceSettings):
    """A camera that looks down on the floor and on one marker on the rover."""

    def make_codec(self, name: str) -> Codec[CameraImage]:
        """Build the codec of the camera called `name`.

        Raises:
            ConfigError: The calibration is missing or wrong, or does not fit the frames or the marker.
        """
        from drivers.overhead_camera.codec import OverheadCameraCodec

        return OverheadCameraCodec(name, self)
