"""What speaks for a gap and for an explanation: scores, tests, sizes, and where errors are."""
