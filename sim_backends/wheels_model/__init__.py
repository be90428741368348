"""Model of a drive of a rover on any set of wheels, for comparison with its logs."""
