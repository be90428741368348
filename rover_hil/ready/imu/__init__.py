"""Identify gain, delay and bandwidth of the gyro, from small turns in place."""
