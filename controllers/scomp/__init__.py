"""Slip-compensated odometry of a four-wheel rover on loose ground, and the slip model behind it."""
