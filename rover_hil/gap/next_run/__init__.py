"""The next run: of the runs that the user allows, the one that separates the explanations that are left."""
