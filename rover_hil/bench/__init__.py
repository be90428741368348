"""The page of `rover-hil bench`: look at a rover while it runs, and operate it."""
