"""Identify slip maps and the yaw probe from runs with a true pose."""
