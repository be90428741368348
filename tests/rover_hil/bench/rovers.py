"""Configurations whose runs begin soon."""

from controllers.motion.settings import ByHandMission
from rover_hil.config import Config, load_config


def quick() -> Config:
    """Return the Robotino, without slip compensation and with a short settling time."""
    config = load_config("robotino")
    safety = config.safety.model_copy(update={"settle_s": 0.2})
    return config.model_copy(update={"slip": None, "safety": safety})


def by_hand() -> Config:
    """Return the same, driven by hand."""
    mission = ByHandMission(type="by_hand", speed_m_s=0.15, yaw_rate_limit_rad_s=1.0)
    return quick().model_copy(update={"mission": mission})
