"""Find offsets between gyro, wheels, compass and cameras by the turns that they all feel."""
