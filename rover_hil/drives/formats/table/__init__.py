"""Tables of any rover become logs."""
