"""Benchmarks of the search for gains, of the cluster and of the speed of simulated missions."""
