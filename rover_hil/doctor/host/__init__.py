"""What this computer has: interfaces, ports, libraries, priorities, networks."""
