"""The cyclic executive: poll, step, command, record, at a fixed rate."""
