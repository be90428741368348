"""The check manoeuvre is driven by `run` alone, and only where a person has confirmed the room for it."""

from rover_hil.config import Config


def without_check_manoeuvre(config: Config) -> Config:
    """Return a configuration whose missions begin without the check manoeuvre."""
    if not config.safety.check_manoeuvre:
        return config
    return config.model_copy(update={"safety": config.safety.model_copy(update={"check_manoeuvre": False})})
