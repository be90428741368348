"""Renderer of a rearward camera's images: ground, ruts, light and shadow."""
