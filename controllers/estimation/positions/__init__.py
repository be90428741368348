"""Measured positions and poses."""
