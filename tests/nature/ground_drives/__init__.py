"""Drives of a rover with a rear-looking camera, rendered with truth."""

from tests.nature.ground_drives.drive import Frame, Renderer, Telemetry, Truth, frames_of, render, write
from tests.nature.ground_drives.scenes import SCENES

__all__ = ["SCENES", "Frame", "Renderer", "Telemetry", "Truth", "frames_of", "render", "write"]
