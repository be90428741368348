"""How much results depend on tuned numbers."""
