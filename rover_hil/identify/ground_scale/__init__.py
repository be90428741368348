"""Scale of a camera that measures the motion over the ground, from drives of which the distance is known."""
