"""A peer with Fast DDS, the middleware of a default ROS 2, built by `make test-ros2`."""
