"""Readers of the shipped models that have files of their own: one module with a `READER` per model."""
