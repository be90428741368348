"""What stands in for the world: rover plants, device emulators on virtual buses, scenes and faults."""
