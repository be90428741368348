"""`rover-hil sample`: small data for the examples, made by the simulators of this program."""
