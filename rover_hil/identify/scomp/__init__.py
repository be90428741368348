"""Fit the slip-compensated odometry to a drive with known truth."""
