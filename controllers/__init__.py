"""Pure computation: kinematics, estimation, path control, limits. No I/O, no threads, no clock."""
