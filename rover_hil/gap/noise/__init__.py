"""Noise of the measurements: of sensors, of replicates, of random forces."""
