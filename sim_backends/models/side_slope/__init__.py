"""A four-wheel rover that traverses a slope of sand."""
