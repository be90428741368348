"""`rover-hil calibrate`: one module for each command."""
