"""Every error that this software raises on purpose: what happened, where, and how to fix it."""


class RoverHilError(Exception):
    """Base of all our errors; the command line prints the message and exits with 2."""


class ConfigError(RoverHilError, ValueError):
    """A configuration or data file holds a mistake; the message names file, key and fix, a line each."""


class NotConnectedError(RoverHilError, ConnectionError):
    """A device could not be opened, or was used before `connect`."""


class LinkTimeoutError(RoverHilError, TimeoutError):
    """A device stayed silent for longer than the caller allowed."""


class StaleSampleError(RoverHilError, TimeoutError):
    """The newest sample is older than the caller accepts."""


class LogError(RoverHilError, ValueError):
    """A log cannot be read or written, or holds something it must not."""


class ModelError(RoverHilError, ValueError):
    """An argument is outside the domain of a model; the message names parameter, value, unit, range."""
