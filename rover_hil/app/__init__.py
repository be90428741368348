"""The `rover-hil` command."""
