"""The odometry of a four-wheel rover with gyro and compass."""
