"""Benchmarks of the identification of motors, slip maps and sComp."""
