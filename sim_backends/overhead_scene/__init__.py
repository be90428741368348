"""Renderer of the simulated overhead camera's images."""
