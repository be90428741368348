"""Checks of the numbers that a user declares of a model."""

from drivers.errors import ConfigError


def require_positive(owner: str, **numbers: float) -> None:
    """Check that numbers are above 0.

    Raises:
        ConfigError: One is 0, negative, or no number.
    """
    for key, value in numbers.items():
        if not value > 0.0:
            raise ConfigError(f"{owner}: {key} is {value:g}, must be > 0")


def require_not_negative(owner: str, **numbers: float) -> None:
    """Check that numbers are 0 or above; see `require_positive`."""
    for key, value in numbers.items():
        if not value >= 0.0:
            raise ConfigError(f"{owner}: {key} is {value:g}, must be >= 0")


def require_bounds(owner: str, lower: float, nominal: float, upper: float) -> None:
    """Check that two bounds are in order and enclose a nominal value.

    Raises:
        ConfigError: They do not, or one is no number.
    """
    if not lower <= upper:
        raise ConfigError(f"{owner}: lower is {lower:g}, must be <= upper, which is {upper:g}")
    if not lower <= nominal <= upper:
        raise ConfigError(
            f"{owner}: nominal is {nominal:g}, must be within lower and upper, {lower:g} to {upper:g}"
        )
