"""Bench-tuning: search for gains on the simulated rover, and compare them on sites not searched."""
