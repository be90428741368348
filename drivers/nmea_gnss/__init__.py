"""GNSS receivers with NMEA 0183."""
