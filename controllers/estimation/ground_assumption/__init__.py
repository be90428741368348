"""What is assumed about the slip of wheels whose slip is not measured, and its test while driving."""
