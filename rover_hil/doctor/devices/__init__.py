"""What the devices send."""
