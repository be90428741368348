"""What a configuration means, without its devices."""
