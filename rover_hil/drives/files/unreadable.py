"""What is wrong with a file of a format, in words for the user."""


class UnreadableError(ValueError):
    """A file cannot be read; the text says why, and which command or program helps."""
