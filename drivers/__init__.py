"""Drivers of the rover's devices: samples, the driver contract, and one folder per device."""
