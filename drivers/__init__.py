"""Drivers of the rover's devices: samples, the driver contract, and one folder per device."""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from drivers.files import IMAGE_PIXELS

if TYPE_CHECKING:
    from drivers.clock import Clock, SystemClock, VirtualClock, nanoseconds, seconds
    from drivers.driver import Driver
    from drivers.errors import ConfigError, LogError, NotConnectedError, RoverHilError
    from drivers.samples import HeadingSample, PoseFixSample, RateSample, Sample, WheelSample

# OpenCV reads it once, when it is loaded. Its own limit lets a picture of some kilobytes fill 3 GB.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(IMAGE_PIXELS))

__all__ = [
    "Clock",
    "ConfigError",
    "Driver",
    "HeadingSample",
    "LogError",
    "NotConnectedError",
    "PoseFixSample",
    "RateSample",
    "RoverHilError",
    "Sample",
    "SystemClock",
    "VirtualClock",
    "WheelSample",
    "nanoseconds",
    "seconds",
]

_MODULES = {
    "Clock": "drivers.clock",
    "ConfigError": "drivers.errors",
    "Driver": "drivers.driver",
    "HeadingSample": "drivers.samples",
    "LogError": "drivers.errors",
    "NotConnectedError": "drivers.errors",
    "PoseFixSample": "drivers.samples",
    "RateSample": "drivers.samples",
    "RoverHilError": "drivers.errors",
    "Sample": "drivers.samples",
    "SystemClock": "drivers.clock",
    "VirtualClock": "drivers.clock",
    "WheelSample": "drivers.samples",
    "nanoseconds": "drivers.clock",
    "seconds": "drivers.clock",
}


def __getattr__(name: str) -> Any:
    """Return a public name; its module is loaded when it is first asked for."""
    module = _MODULES.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(module), name)
