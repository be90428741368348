"""Simulators: rover plants, device emulators on virtual buses, camera scenes and faults."""
