"""Xsens MTi inertial sensors with MTData2 messages."""
