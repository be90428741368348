"""Fit radius and base of the wheels to known distances and known turns, with intervals."""
