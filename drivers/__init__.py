"""Drivers of the rover's devices: samples, the driver contract, and one folder per device."""

import os

from drivers.files import IMAGE_PIXELS

# OpenCV reads it once, when it is loaded. Its own limit lets a picture of some kilobytes fill 3 GB.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(IMAGE_PIXELS))
