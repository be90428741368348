"""Values of the settings of every device that measures in frames; links and codecs read them."""

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from drivers.device_settings import FrameDeviceSettings
from drivers.settings import PathText

Pixels: TypeAlias = Annotated[int, Field(ge=16, le=8192)]

_ONLY_FOR = {
    "fourcc": ("v4l2",),
    "exposure_100us": ("v4l2",),
    "loop": ("folder", "video"),
}


class FrameSourceParameters(FrameDeviceSettings):
    """Where frames come from: a camera, or recorded frames in its place.

    Attributes:
        source: "v4l2" is a camera of this machine; "folder" a finished folder of images, played on the clock;
            "live_folder" a folder that another process fills (`rover-hil simulate` does); "video" a video
            file, played on the clock.
        path: Path of the device, folder or file; for a device prefer `/dev/v4l/by-id/...`, it survives a
            replug.
        width: Width of the images in pixels; images of another width are rejected.
        height: Height of the images in pixels; images of another height are rejected.
        frame_rate_hz: Frames per second. A folder whose file names are time stamps in nanoseconds is played
            at their spacing instead.
        fourcc: Pixel format requested from a V4L2 device.
        exposure_100us: Exposure of a V4L2 device in units of 100 us; without it the camera chooses the
            exposure.
        loop: Start again at the end of a folder or video, instead of reporting a broken link.
    """

    source: Literal["v4l2", "folder", "live_folder", "video"]
    path: PathText
    width: Pixels
    height: Pixels
    frame_rate_hz: Annotated[float, Field(gt=0, le=240)]
    fourcc: Annotated[str, Field(pattern=r"^[A-Z0-9 ]{4}$")] = "MJPG"
    exposure_100us: Annotated[int, Field(ge=1, le=100_000)] | None = None
    loop: bool = False
    max_age_s: Annotated[float, Field(gt=0, le=10)] = 0.5

    @model_validator(mode="after")
    def _check(self) -> Self:
        for key, sources in _ONLY_FOR.items():
            is_default = getattr(self, key) == type(self).model_fields[key].default
            if not is_default and self.source not in sources:
                raise ValueError(
                    f"{key} is for source = {' or '.join(sources)}, not for '{self.source}': remove it"
                )
        if self.max_age_s * self.frame_rate_hz <= 1:
            raise ValueError(
                f"max_age_s = {self.max_age_s:g} is not longer than one period of frame_rate_hz = "
                f"{self.frame_rate_hz:g}, so every frame would count as too old: raise max_age_s"
            )
        return self
