"""Drivers of the rover's devices: samples, the driver contract, and one folder per device."""

import os
from typing import TYPE_CHECKING

from drivers.files import IMAGE_PIXELS
from drivers.public_names import public_names

if TYPE_CHECKING:
    from drivers.clock import Clock as Clock
    from drivers.clock import SystemClock as SystemClock
    from drivers.clock import VirtualClock as VirtualClock
    from drivers.clock import nanoseconds as nanoseconds
    from drivers.clock import seconds as seconds
    from drivers.driver import Driver as Driver
    from drivers.errors import ConfigError as ConfigError
    from drivers.errors import LogError as LogError
    from drivers.errors import NotConnectedError as NotConnectedError
    from drivers.errors import RoverHilError as RoverHilError
    from drivers.samples import HeadingSample as HeadingSample
    from drivers.samples import PoseFixSample as PoseFixSample
    from drivers.samples import RateSample as RateSample
    from drivers.samples import Sample as Sample
    from drivers.samples import WheelSample as WheelSample

# OpenCV reads it once, when it is loaded. Its own limit lets a picture of some kilobytes fill 3 GB.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(IMAGE_PIXELS))

__getattr__ = public_names(__name__)
