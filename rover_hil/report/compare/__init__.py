"""`rover-hil compare`: runs side by side."""
