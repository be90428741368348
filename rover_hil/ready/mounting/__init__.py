"""Find mounting, scale and bias of the gyro, from whole turns between rests."""
