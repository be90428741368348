"""Wheels on soil: speed, and the published measurements."""
