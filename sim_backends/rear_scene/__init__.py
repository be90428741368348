"""What a rearward camera sees: ground, ruts, light and shadow, with exact truth."""
