"""The records of a run as they are made, for viewers on this computer."""
