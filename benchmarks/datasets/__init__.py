"""Recorded drives of other people, from their files to logs."""
