"""Find the field of the motor currents at a calibrated compass, in two squares."""
