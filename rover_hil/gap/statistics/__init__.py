"""Errors, fits and scores."""
