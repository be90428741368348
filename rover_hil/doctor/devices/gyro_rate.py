"""Compare the rate of the gyro with the one that it is configured to have."""

from drivers.inertial_settings import InertialSettings
from drivers.samples import RateSample
from rover_hil.config import Config
from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.devices.streams import stream_of
from rover_hil.doctor.finding import Finding, warning


def check_gyro_rate(reception: Reception, config: Config) -> list[Finding]:
    """Return a finding where the gyro sends at another rate than `rate_hz`; else nothing."""
    settings, factor = reception.settings, config.safety.gyro_rate_factor
    if reception.device != config.roles.gyro or not isinstance(settings, InertialSettings):
        return []
    arrivals_ns = [sample.t_ns for sample in reception.samples if isinstance(sample, RateSample)]
    stream = stream_of(arrivals_ns, reception.start_ns, reception.end_ns)
    rate_hz = stream.rate_hz
    if settings.rate_hz is None or stream.is_burst or reception.pause_s > settings.max_age_s or not rate_hz:
        return []
    if 1.0 / factor <= rate_hz / settings.rate_hz <= factor:
        return []
    what = f"yaw rate: {rate_hz:.1f} Hz, configured are {settings.rate_hz:g} Hz"
    cause = "the sensor has another setting, or is another one; its low-pass may differ, too"
    fix = f"set the sensor, or rate_hz in [devices.{reception.device}]; then run `rover-hil calibrate imu`"
    return [warning("rate", reception.device, what, cause, fix)]
