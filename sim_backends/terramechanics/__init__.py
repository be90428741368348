"""Wheel-soil and slope models (papers 001 and 002)."""
