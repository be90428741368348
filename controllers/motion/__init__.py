"""Where the rover shall go: kinematics, path following, mission, limits."""
