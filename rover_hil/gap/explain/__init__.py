"""Whether there is a gap, where, what explains it, and whether it holds on the locked runs."""
