"""Rendered drives over grounds that mislead a camera, with truth.

Run `python -m tests.nature.ambiguous_ground FOLDER`.
"""
