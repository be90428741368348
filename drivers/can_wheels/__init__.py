"""Wheel encoders and wheel drives on a CAN bus, described by a DBC file and a mapping."""
