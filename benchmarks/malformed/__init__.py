"""Malformed files of every kind, for `benchmarks.malformed_files`."""
