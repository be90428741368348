"""Device emulators, one file for each driver, with the driver's name."""
