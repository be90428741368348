"""Identify how a gyro follows turns: gain, delay and bandwidth."""
