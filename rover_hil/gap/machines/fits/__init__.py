"""Fits of a machine with some effects."""
