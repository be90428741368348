"""What speaks for an explanation, and how large its effects are."""
