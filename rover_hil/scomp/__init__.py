"""Slip-compensated odometry of recorded drives: reading logs, writing paths and parameters, pictures."""
