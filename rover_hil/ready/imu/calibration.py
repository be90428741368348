"""`rover-hil calibrate imu`: gain, delay and bandwidth of the gyro, from small turns in place."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from controllers.control_loop import StepOutput
from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.motion.settings import SmallTurnsMission
from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.yaw_excitation import ExcitationSettings
from drivers.clock import date_of, wall_time_ns
from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.drives.toml_text import toml_text
from rover_hil.pages.picture import Drawing
from rover_hil.ready.imu.figures import draw_response
from rover_hil.ready.imu.fit import ResponseFit, fit_response
from rover_hil.ready.imu.turns import Turns, read_turns
from rover_hil.ready.options import command
from rover_hil.ready.procedure import Drive, Entry, Facts, FileProcedure, Request
from rover_hil.run.checks import RUN_CHECKS

RATE_SHARE = 0.86
"""Of the configured rate of the loop: setpoints that change at the gyro's rate alias onto the turns."""
SPARE_S = 15.0
"""In addition to the turns: settling, and stops."""


@command("source", "virtual", "drive", "out")
def calibrate() -> "GyroCalibration":
    """Identify gain, delay and bandwidth of the gyro, from small turns in place.

    The rover turns back and forth for a minute, on firm ground with half a metre of free space. The page with
    the picture is written before the file. Exit code 1: the result is not sure; the file is not written.

    Example: `rover-hil calibrate imu robotino --virtual --out gyro.toml`

    Data: a drive of your rover on firm ground, or a log of one; docs/how-to/calibrate_the_gyro.md.
    """
    return GyroCalibration()


@dataclass(frozen=True, slots=True)
class GyroResult:
    """The fit, and the constants for the configuration."""

    fit: ResponseFit
    response: GyroResponse

    @property
    def problem(self) -> str:
        """Why the constants must not be used; empty where they may."""
        return self.fit.problem


class GyroCalibration(FileProcedure[Turns, GyroResult]):
    """Gain, delay and bandwidth of the gyro of a rover with three omnidirectional wheels."""

    checks = RUN_CHECKS

    def __init__(self) -> None:
        self._excitation_hz = ExcitationSettings().frequency_hz

    def configure(self, request: Request, config: Config | None) -> Path | None:
        if config is not None and config.slip is not None:
            self._excitation_hz = config.slip.excitation.frequency_hz
        return request.out

    def drives(self, config: Config) -> Sequence[Drive]:
        turning = small_turns_config(config)
        drive = Drive(
            name="turns",
            config=turning,
            limit_s=turning.loop.time_limit_s,
            words="turning back and forth",
            status=_status,
            must_finish=False,
        )
        return (drive,)

    def read(self, logs: Sequence[Path]) -> Turns:
        return read_turns(logs[0])

    def fit(self, record: Turns) -> GyroResult:
        fit = fit_response(record, self._excitation_hz)
        response = {
            "source": f"{record.path.name}, {fit.seconds:.0f} s of turns in place",
            "identified_on": date_of(wall_time_ns()).isoformat(),
            "gain": min(max(fit.gain, 0.5), 2.0),
            "gain_sd": min(fit.gain_sd, 1.0),
            "delay_s": fit.delay_s,
            "delay_sd_s": min(fit.delay_sd_s, 0.3),
            "bandwidth_hz": max(fit.bandwidth_hz, 0.5),
            "bandwidth_sd_hz": fit.bandwidth_sd_hz,
        }
        return GyroResult(fit, GyroResponse.model_validate(response))

    def title(self, record: Turns, result: GyroResult) -> str:
        if result.problem:
            return f"Gyro: not identified, {result.problem}"
        return "Gyro: gain, delay and bandwidth"

    def facts(self, record: Turns, result: GyroResult) -> Facts:
        response = result.response
        bandwidth = f"{response.bandwidth_hz:.1f} +- {response.bandwidth_sd_hz:.1f} Hz"
        if response.bandwidth_sd_hz >= response.bandwidth_hz:
            bandwidth = f"no low-pass found (fit: {bandwidth})"
        return (
            ("gain", f"{response.gain:.3f} +- {response.gain_sd:.3f}"),
            ("delay", f"{1e3 * response.delay_s:.1f} +- {1e3 * response.delay_sd_s:.1f} ms"),
            ("bandwidth", bandwidth),
            ("not explained", f"{100 * result.fit.residual:.0f} % of the readings"),
            ("turns in place", f"{result.fit.seconds:.0f} s"),
        )

    def json(self, record: Turns, result: GyroResult, out: Path | None) -> dict[str, object]:
        constants = result.response.model_dump(mode="json")
        return {**constants, "problem": result.problem, "residual": result.fit.residual}

    def figures(self, record: Turns, result: GyroResult) -> Sequence[Drawing]:
        caption = (
            "See whether the line goes through the dots. Each dot is one second of turns. A low-pass lets "
            "the share fall with the frequency; "
            "a delay gives the same lag at all frequencies and leaves the share."
        )
        return (
            Drawing("Share and lag of the gyro", caption, lambda: draw_response(record, result.response)),
        )

    def write(self, record: Turns, result: GyroResult) -> str:
        return toml_text(result.response.model_dump(), digits=5)

    def entries(self, record: Turns, result: GyroResult, out: Path | None) -> Sequence[Entry]:
        return (Entry("slip", "gyro_response", str(out)),)


def small_turns_config(config: Config) -> Config:
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


def _status(output: StepOutput) -> str:
    return f"yaw {math.degrees(output.estimate.yaw_rad):+.0f} deg  {output.reason}"
