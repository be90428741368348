"""Find the scale of the travel that a ground camera measures."""
