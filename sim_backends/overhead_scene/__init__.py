"""What the simulated overhead camera sees."""
