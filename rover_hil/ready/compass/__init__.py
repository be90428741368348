"""Calibrate a compass by whole turns: hard and soft iron, or a deviation table."""
