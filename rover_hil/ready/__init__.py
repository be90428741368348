"""Get a rover ready: set it up, calibrate its sensors, commission it."""
