"""Import of runs recorded by others as logs."""
