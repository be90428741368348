"""Wheel and soil: reading tests, fitting, tables and plots."""
