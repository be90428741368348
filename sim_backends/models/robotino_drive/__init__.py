"""The odometry of a Robotino below an overhead camera."""
