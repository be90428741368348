"""One MCAP file per run: raw bytes before parsing, samples, estimates, commands, health."""
