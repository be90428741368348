"""Import of logs of a CAN bus."""
