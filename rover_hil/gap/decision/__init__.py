"""From evidence to the verdict."""
