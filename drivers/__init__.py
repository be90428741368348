"""What the rover's devices say and accept: samples, the driver contract, and one folder per device."""
