"""The battery of hidden effects, and what the models of `rover-hil gap` find in measured data."""
