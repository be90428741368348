"""Tuning: search for gains on the simulated rover and compare them on held-out scenarios."""
