"""Compasses and attitude sensors with NMEA 0183."""
