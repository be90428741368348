"""Puts a rover together and runs it at a fixed rate, on real, simulated or replayed devices."""
