"""Readers of the files of other programs: tables, arrays, flight logs, CAN logs."""
