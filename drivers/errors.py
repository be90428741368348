"""Every error this software raises on purpose: says what, where, and how to fix it in one sentence."""


class RoverHilError(Exception):
    """Base of all our errors; the command line prints it as one sentence and exits with 2."""


class ConfigError(RoverHilError, ValueError):
    """A configuration or data file holds something wrong; the message names file, key and fix."""


class NotConnectedError(RoverHilError, ConnectionError):
    """A device could not be opened, or was used before `connect`."""


class LinkTimeoutError(RoverHilError, TimeoutError):
    """A device stayed silent for longer than the caller allowed."""


class StaleSampleError(RoverHilError, TimeoutError):
    """The newest sample is older than the caller accepts."""


class LogError(RoverHilError, ValueError):
    """A log cannot be read or written, or holds something it must not."""


class ModelError(RoverHilError, ValueError):
    """A model was asked for something outside its domain; the message names parameter, value, unit, range."""
