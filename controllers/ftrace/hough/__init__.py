"""The trace finder as printed in paper 000: Hough lines and fuzzy rules."""
