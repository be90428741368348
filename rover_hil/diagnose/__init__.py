"""What recorded drives show of a rover: one page over what the other commands fit and judge."""
