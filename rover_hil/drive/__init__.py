"""The commands that let a rover drive, and drive it again: `run`, `simulate`, `replay`."""
