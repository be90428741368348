"""What connects a run with other programs while the rover drives."""
