"""The commands `rover-hil identify`."""
