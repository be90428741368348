"""Slip from motor effort and yaw excitation, for an omnidirectional rover (paper 003)."""
