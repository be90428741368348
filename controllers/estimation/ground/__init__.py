"""Motion over the ground that a camera measures."""
