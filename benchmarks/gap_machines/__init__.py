"""The gap workflow on machines with hidden effects (tests/nature/machines)."""
