"""Offsets between the clocks of devices that feel the same turns."""
