"""Laws that no effect describes."""
