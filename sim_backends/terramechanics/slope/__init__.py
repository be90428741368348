"""A rover on a slope of soil: loads of its wheels, steady states, drives along a path."""
