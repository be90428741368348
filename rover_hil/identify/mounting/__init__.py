"""Mounting, scale and bias of a gyro, from whole turns between rests."""
