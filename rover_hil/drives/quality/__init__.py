"""What is wrong with a recorded drive: clocks, contradictions, units and signs."""
