"""Motion by the wheels, and what may be wrong with it."""
