"""The simulated world: plant, lines between devices and host, faults, sensor errors."""
