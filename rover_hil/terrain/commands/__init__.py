"""The commands `rover-hil terrain`."""
