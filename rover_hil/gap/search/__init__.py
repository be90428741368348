"""The search for effects, and for laws that no effect describes."""
