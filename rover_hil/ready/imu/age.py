"""Age of the constants of the gyro."""

import datetime as dt

from rover_hil.config import Config
from rover_hil.doctor.finding import Finding
from rover_hil.ready.dated import dated


def check_age(config: Config, today: dt.date) -> list[Finding]:
    """Check the constants in use."""
    gyro = None if config.slip is None else config.slip.gyro_response
    if gyro is None or config.roles.gyro is None:
        return []
    finding = dated(
        config.roles.gyro,
        gyro.identified_on,
        today,
        fresh=f"delay and bandwidth of {gyro.identified_on}",
        old=f"its delay and bandwidth are of {gyro.identified_on}",
        cause="another sensor, filter or baud rate delays turns by another time",
        command="rover-hil calibrate imu CONFIG",
    )
    return [finding]
