"""The commands `rover-hil gap`."""
