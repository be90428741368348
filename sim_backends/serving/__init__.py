"""Serves a simulated rover in real time on the bus protocols of the real one."""
