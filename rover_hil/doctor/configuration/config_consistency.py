"""Check settings that are valid one by one but do not fit each other."""

from controllers.slip.effort.settings import YAW_PROBE
from controllers.unwatched_yaw import find_unwatched_yaw
from drivers.robotino3_board.settings import Robotino3BoardSettings
from drivers.robotino_board.settings import RobotinoBoardSettings
from rover_hil.config import Config
from rover_hil.doctor.finding import Finding, ok, problem, warning
from rover_hil.run.excitation import for_real_rover

CHECK = "configuration"


def check_consistency(config: Config) -> list[Finding]:
    """Compare the times in the configuration with the period of the loop, and find what nothing watches."""
    findings: list[Finding] = []
    rate_hz, expiry_s = config.loop.rate_hz, config.safety.expiry_s
    if expiry_s * rate_hz < 2:
        report = problem if expiry_s * rate_hz <= 1 else warning
        findings.append(
            report(
                CHECK,
                "safety",
                f"expiry_s = {expiry_s:g} is less than two periods at rate_hz = {rate_hz:g}",
                "setpoints expire before the next ones come, so one late cycle stops the rover",
                f"in [safety] set expiry_s = {min(1.0, 3 / rate_hz):g}, or raise rate_hz in [loop]",
            )
        )
    for name, settings in config.devices.items():
        is_board = isinstance(settings, RobotinoBoardSettings | Robotino3BoardSettings)
        if is_board and settings.max_age_s * rate_hz < 2:
            findings.append(
                problem(
                    CHECK,
                    name,
                    f"max_age_s = {settings.max_age_s:g} is less than two periods at rate_hz = {rate_hz:g}",
                    "the board answers once per cycle, so its samples are too old before the next come",
                    f"in [devices.{name}] set max_age_s = {3 / rate_hz:g}, or raise rate_hz in [loop]",
                )
            )
    findings += _check_yaw(config)
    findings += _check_excitation(config)
    return findings or [ok(CHECK, "times", "the periods and limits fit each other")]


def _check_yaw(config: Config) -> list[Finding]:
    unwatched = find_unwatched_yaw(for_real_rover(config)[0], config.device_roles())
    if unwatched is None:
        return []
    cause = "a wrong yaw looks like a rover that keeps its heading"
    return [warning(CHECK, "yaw unwatched", unwatched.what, cause, unwatched.help)]


def _check_excitation(config: Config) -> list[Finding]:
    slip = config.slip
    if slip is None or slip.use != YAW_PROBE:
        return []
    findings = [] if slip.gyro_response is not None else [_unknown_gyro()]
    excitation = slip.excitation
    if excitation.yaw_inertia_kg_m2 is None and "mass_kg" not in excitation.model_fields_set:
        what = f"the mass of the rover is not given: {excitation.mass_kg:g} kg is assumed"
        cause = "slip by the yaw excitation is read too small where the rover is lighter"
        fix = "weigh the rover with its load and enter mass_kg in [slip.excitation]"
        findings.append(warning(CHECK, "slip.excitation", what, cause, fix))
    return findings


def _unknown_gyro() -> Finding:
    what = "delay and bandwidth of the gyro are unknown: slip by the yaw excitation is unsure"
    cause = "a late gyro looks like wheels that slip, so only the least slip is used"
    fix = "run `rover-hil calibrate imu`, and enter its file as gyro_response in [slip]"
    return warning(CHECK, "slip.gyro_response", what, cause, fix)
