"""Age of the scale of the ground camera."""

import datetime as dt

from rover_hil.config import Config
from rover_hil.doctor.finding import Finding
from rover_hil.ready.dated import dated


def check_age(config: Config, today: dt.date) -> list[Finding]:
    """Check the scale in use."""
    if config.ground_motion is None or config.roles.camera is None:
        return []
    tolerance = config.ground_motion.tolerance
    if tolerance.scale_date is None:
        return []
    finding = dated(
        config.roles.camera,
        tolerance.scale_date,
        today,
        fresh=f"scale {tolerance.scale:g} of {tolerance.scale_date}",
        old=f"its scale is of {tolerance.scale_date}",
        cause="a camera whose height or pitch has changed measures another distance",
        command="rover-hil calibrate scale CONFIG --enter --out FILE",
    )
    return [finding]
