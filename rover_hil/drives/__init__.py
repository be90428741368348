"""Measured data, each format read once: logs of this software, Robotino data sets, CSV tables."""
