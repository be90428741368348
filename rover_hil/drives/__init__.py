"""Recorded drives: one drive for all analyses, the files of others as logs, and what is wrong with them."""
