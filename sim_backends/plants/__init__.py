"""Simulated rovers."""
