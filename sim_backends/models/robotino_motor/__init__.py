"""A gear motor behind the speed loop of its board."""
