"""Find out what is connected to this computer, and write the configuration of a rover."""
