"""A dynamic rover on any set of wheels, on a test site of patches."""
