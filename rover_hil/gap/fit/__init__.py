"""Fits of a machine, and machines that can only be called."""
