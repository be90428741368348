"""Compasses and attitude sensors that speak NMEA 0183."""
