"""Missions: each with its keys and what drives it in one file."""
