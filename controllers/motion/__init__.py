"""Motion of the rover: kinematics, path following, mission, limits."""
