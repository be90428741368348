"""Turn by the gyro, and standstill by gyro and accelerometer."""
