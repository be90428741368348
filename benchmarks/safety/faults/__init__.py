"""Faults of devices and of the program: cases, injection, measures."""
