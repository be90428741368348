"""What must not get worse: floors that nobody fitted, field figures and faults, against published tables."""
