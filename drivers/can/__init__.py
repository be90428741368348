"""CAN frames, the link that carries them, and what every CAN drive reports."""
