"""Identify slip maps from runs with a true pose."""
