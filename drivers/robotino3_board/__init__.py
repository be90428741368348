"""Input-output board of Robotino 3 and 4 on USB."""
