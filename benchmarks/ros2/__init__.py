"""Figures of the connection with ROS 2."""
