"""How the safety of the loop is measured: healthy missions, and faults of its sensors."""
