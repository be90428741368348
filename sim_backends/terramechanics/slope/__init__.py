"""A rover on a slope of soil: wheel loads and steady states."""
