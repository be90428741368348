"""ROS 2 through DDS, without an installation of ROS."""
