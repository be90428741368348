"""`rover-hil calibrate imu`: gain, delay and bandwidth of the gyro, from small turns in place."""

from pathlib import Path

from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.motion.settings import SmallTurnsMission
from controllers.slip.effort.gyro_response import GyroResponse
from drivers.clock import wall_time_text
from drivers.errors import ConfigError
from rover_hil.app.calibrate.results import check_results
from rover_hil.config import Config, load_config
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.datasets.toml_text import toml_text
from rover_hil.identify.gyro.figures import draw_response
from rover_hil.identify.gyro.response_fit import ResponseFit, fit_response
from rover_hil.identify.gyro.turns import Turns, read_turns
from rover_hil.pages.atomic_write import write_file
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.run.checks import RUN_CHECKS, VIRTUAL_RUN_CHECKS
from rover_hil.run.drive_permission import permit_drive
from rover_hil.run.driving import require_uninterrupted, run_real, run_virtual
from rover_hil.terminal import Terminal
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.robotino.site import load_site
from sim_backends.settings import SimulationSettings

LOG_SUFFIX = ".mcap"
RATE_SHARE = 0.86
"""Of the configured rate of the loop: set-points that change at the gyro's rate alias onto the turns."""
FIRM_SITE = "floor_table"
SPARE_S = 15.0
"""In addition to the turns: settling, and stops."""


def calibrate_imu(
    source: str, *, virtual: bool, drive: bool = False, out: Path, as_json: bool, force: bool = False
) -> int:
    """Identify the gyro and write its constants; returns the exit code: 1, and no file, if they are not sure.

    The page with the picture is written first, also where the constants are not sure.

    Args:
        source: A configuration, whose rover is driven, or a log.
        virtual: Drive the simulated rover, on firm ground.
        drive: Drive the real one without a question.
        out: File to write; the page has its name with `.html`, the log of the drive with `.mcap`.
        as_json: Print JSON instead of text.
        force: Replace earlier files.

    Raises:
        ConfigError: The configuration or the log cannot be used, or a file exists.
        LogError: The log is damaged or holds no turns.
    """
    log_path = out.with_suffix(LOG_SUFFIX)
    is_log = source.endswith(LOG_SUFFIX)
    page = check_results(out, () if is_log else (log_path,), force=force)
    if is_log and (virtual or drive):
        raise ConfigError(f"{source} is a log: leave --virtual and --drive out, or name a configuration")
    if is_log:
        log_path = Path(source)
    else:
        _drive(source, log_path, virtual=virtual, drive=drive)
    turns = read_turns(log_path)
    fit = fit_response(turns)
    response = _response(fit, log_path)
    write_file(page, _page(turns, fit, response))
    if as_json:
        record = {**response.model_dump(mode="json"), "problem": fit.problem, "residual": fit.residual}
        print_json(record)
    else:
        console = Terminal(soft_wrap=True)
        for name, value in _facts(fit, response):
            console.print(f"{name}: {value}")
        console.print(f"picture: {page}")
        if fit.problem:
            console.print(f"not written: {fit.problem}")
        else:
            console.print(f'written to {out}; in the configuration: [slip] gyro_response = "{out}"')
    if fit.problem:
        return EXIT_NO
    write_file(out, toml_text(response.model_dump(), digits=5))
    return EXIT_OK


def _drive(name: str, log_path: Path, *, virtual: bool, drive: bool) -> None:
    """Let the rover of a configuration turn in place, into a log."""
    config = turning_config(load_config(name, VIRTUAL_RUN_CHECKS if virtual else RUN_CHECKS))
    order = permit_drive(name, config, virtual=virtual, drive=drive)
    limit_s = config.loop.time_limit_s
    if order is None:
        config = config.model_copy(update={"simulation": on_firm_floor(config.require_simulation())})
        result = run_virtual(config, log_path, limit_s, None)
    else:
        result = run_real(config, log_path, limit_s, lambda output: None, order=order)
    require_uninterrupted(result)


def turning_config(config: Config) -> Config:
    """Return a configuration with small turns for a mission, no slip compensation, and a slower loop.

    Raises:
        ConfigError: It names no gyro, or describes a rover with other wheels than three omnidirectional ones.
    """
    if config.roles.gyro is None:
        raise ConfigError("roles.gyro is not set: name the device that measures the yaw rate")
    if not isinstance(config.rover, OmniRoverSettings):
        raise ConfigError(
            f"rover.kinematics is '{config.rover.kinematics}', but the gyro is identified with three "
            "omnidirectional wheels: calibrate it on such a rover"
        )
    mission = SmallTurnsMission(type="small_turns")
    loop = config.loop.model_copy(
        update={
            "rate_hz": RATE_SHARE * config.loop.rate_hz,
            "time_limit_s": len(mission.frequencies_hz) * mission.each_s + config.safety.settle_s + SPARE_S,
        }
    )
    return config.model_copy(update={"mission": mission, "slip": None, "loop": loop})


def on_firm_floor(simulation: SimulationSettings) -> SimulationSettings:
    """Return the simulation with firm ground everywhere: a user, too, has to choose such a place."""
    if not isinstance(simulation.plant, RobotinoPlantSettings):
        return simulation
    plant = simulation.plant.model_copy(update={"site": load_site(FIRM_SITE)})
    return simulation.model_copy(update={"plant": plant})


def _response(fit: ResponseFit, log_path: Path) -> GyroResponse:
    return GyroResponse.model_validate(
        {
            "source": f"{log_path.name}, {fit.seconds:.0f} s of turns in place",
            "identified_on": _today(),
            "gain": min(max(fit.gain, 0.5), 2.0),
            "gain_sd": min(fit.gain_sd, 1.0),
            "delay_s": fit.delay_s,
            "delay_sd_s": min(fit.delay_sd_s, 0.3),
            "bandwidth_hz": max(fit.bandwidth_hz, 0.5),
            "bandwidth_sd_hz": fit.bandwidth_sd_hz,
        }
    )


def _today() -> str:
    day = wall_time_text()[:8]
    return f"{day[:4]}-{day[4:6]}-{day[6:]}"


def _facts(fit: ResponseFit, response: GyroResponse) -> tuple[tuple[str, str], ...]:
    bandwidth = f"{response.bandwidth_hz:.1f} +- {response.bandwidth_sd_hz:.1f} Hz"
    if response.bandwidth_sd_hz >= response.bandwidth_hz:
        bandwidth = f"no low-pass found (fit: {bandwidth})"
    return (
        ("gain", f"{response.gain:.3f} +- {response.gain_sd:.3f}"),
        ("delay", f"{1e3 * response.delay_s:.1f} +- {1e3 * response.delay_sd_s:.1f} ms"),
        ("bandwidth", bandwidth),
        ("not explained", f"{100 * fit.residual:.0f} % of the readings"),
        ("turns in place", f"{fit.seconds:.0f} s"),
    )


def _page(turns: Turns, fit: ResponseFit, response: GyroResponse) -> str:
    caption = (
        "See whether the line goes through the dots. Each dot is one second of turns. A low-pass lets the "
        "share fall with the frequency; a delay gives the same lag at all frequencies and leaves the share."
    )
    drawing = Drawing("Share and lag of the gyro", caption, lambda: draw_response(turns, response))
    return render(
        "identify/report.html",
        grade="attention" if fit.problem else "plain",
        title=f"Gyro: not identified, {fit.problem}" if fit.problem else "Gyro: gain, delay and bandwidth",
        facts=_facts(fit, response),
        pictures=draw_pictures([drawing]),
    )
