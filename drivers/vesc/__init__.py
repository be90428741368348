"""VESC motor controllers on a CAN bus, in their own protocol."""
