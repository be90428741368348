"""The yaw excitation on a real rover: only where it has passed a commissioning, or was asked for."""

from controllers.slip.effort.settings import YAW_PROBE
from rover_hil.config import Config

OFF = (
    "the yaw excitation is off, and slip is not compensated: on a real rover it must pass "
    "`rover-hil commission` first (--enter then sets excite_real_rover = true in [slip]); on "
    'ground that you can name set use = "surfaces"'
)


def for_real_rover(config: Config) -> tuple[Config, str]:
    """Return the configuration for a real rover, and what was changed, in words; empty for nothing."""
    slip = config.slip
    if slip is None or slip.use != YAW_PROBE or slip.excite_real_rover:
        return config, ""
    return config.model_copy(update={"slip": None}), OFF
