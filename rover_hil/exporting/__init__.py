"""A log as tables for other programs."""
