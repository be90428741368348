"""Headings of compasses and other devices."""
