"""Age of the scale of the ground camera."""

import datetime as dt

from rover_hil.config import Config
from rover_hil.doctor.finding import Finding, warning
from rover_hil.ready.dated import CHECK, dated


def check_age(config: Config, today: dt.date) -> list[Finding]:
    """Check the scale in use; that it was calibrated at all where the rig looks as one by rulers."""
    if config.ground_motion is None or config.roles.camera is None:
        return []
    tolerance = config.ground_motion.tolerance
    if tolerance.scale_sd is None and not any(config.ground_motion.rig.dist_coeffs.values):
        what = "its rig has no lens distortion, like one by rulers, and its scale is not calibrated"
        cause = "until a rotation on the spot confirms the rig the travel is at least 10 % uncertain"
        fix = "run `rover-hil calibrate scale CONFIG --enter --out FILE`"
        return [warning(CHECK, config.roles.camera, what, cause, fix)]
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
