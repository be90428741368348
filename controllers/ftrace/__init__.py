"""Slip angle from the trace that a rear wheel leaves, seen by a rearward camera (paper 000, section 2)."""
