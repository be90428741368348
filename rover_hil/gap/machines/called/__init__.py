"""Models that can only be called, as machines."""
