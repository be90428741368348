"""Prepared drives of the rear camera's scene with exact truth, for tests and benchmarks."""
