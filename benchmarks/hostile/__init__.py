"""Hostile files of every kind, for `benchmarks.hostile_files`."""
