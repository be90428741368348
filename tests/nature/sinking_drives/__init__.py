"""Synthetic drives of a slipping, sinking rover, seen by its rear camera."""
