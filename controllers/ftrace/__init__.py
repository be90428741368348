"""Slip angle from the trace of a rear wheel in the frames of a rearward camera (paper 000, section 2)."""
