"""Where the rover is: odometry, gyro, pose fixes and the pose filter."""
