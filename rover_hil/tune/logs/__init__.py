"""Tuning of filter noise by replay of logs."""
