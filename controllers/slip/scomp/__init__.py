"""Slip-compensated odometry of a four-wheel rover, online (paper 000)."""
