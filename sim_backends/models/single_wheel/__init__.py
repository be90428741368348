"""A single wheel in a test bed."""
