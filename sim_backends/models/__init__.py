"""Models whose predictions are compared with measured runs, and the effects that may be missing in them."""
