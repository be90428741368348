"""Runs: where they come from, and as vectors of observations."""
