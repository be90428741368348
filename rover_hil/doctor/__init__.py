"""Checks a rover before it drives: devices, permissions, rates, clocks, calibration."""
