"""Identify the motors behind the wheels."""
