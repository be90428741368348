"""Calibrate a compass from turns: hard and soft iron of a magnetometer, deviation of a compass."""
