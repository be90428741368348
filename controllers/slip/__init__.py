"""Slip compensators: from effort (motor current) and from the wheel trace (sComp)."""
