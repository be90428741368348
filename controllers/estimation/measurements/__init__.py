"""Measurement models: what a sensor is expected to read, by the state of the pose filter."""
