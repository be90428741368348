"""Settings of a camera, and of all devices that measure with frames."""

from typing import Literal

from drivers.camera.parameters import FrameSourceParameters
from drivers.clock import Clock
from drivers.driver import Codec
from drivers.link import CameraImage, Link


class FrameSourceSettings(FrameSourceParameters):
    """Where frames come from, and the link that brings them."""

    def exclusive_port(self) -> tuple[str, str] | None:
        """Return the device, or the folder that one camera fills; recorded frames may be read by many."""
        return ("path", self.path) if self.source in ("v4l2", "live_folder") else None

    def make_link(self, clock: Clock) -> Link[CameraImage]:
        """Build the link to the camera, folder or video file; nothing is opened yet."""
        import cv2

        cv2.setNumThreads(1)  # more threads would take the control loop's processor from it
        if self.source == "v4l2":
            from drivers.camera.v4l2_link import V4l2Link

            return V4l2Link(self, clock)
        if self.source == "video":
            from drivers.camera.video_link import VideoLink

            return VideoLink(self, clock)
        from drivers.camera.folder_link import FolderLink, LiveFolderLink

        return FolderLink(self, clock) if self.source == "folder" else LiveFolderLink(self, clock)


class CameraSettings(FrameSourceSettings):
    """A camera whose frames are samples."""

    type: Literal["camera"]

    def make_codec(self, name: str) -> Codec[CameraImage]:
        """Build the codec of the camera called `name`."""
        from drivers.camera.codec import CameraCodec

        return CameraCodec(name, self.width, self.height)
