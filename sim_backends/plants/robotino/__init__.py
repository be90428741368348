"""A dynamic Robotino plant on a test site of patches."""
