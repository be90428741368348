"""Motion and light of the ground plane in the rear camera's frames."""
