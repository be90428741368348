"""One mission on the simulated rover, as fast as possible and without a log."""

import gc
import math
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass

import numpy as np

from controllers.safety import Mode
from controllers.slip.effort.settings import YAW_PROBE
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.errors import ConfigError
from drivers.link import NoTap
from rover_hil.config import Config
from rover_hil.drives.arrays import Array
from rover_hil.report.tracks import Track
from rover_hil.run.check_manoeuvre import without_check_manoeuvre
from rover_hil.run.composition import build_virtual_rig
from rover_hil.tune.metrics import (
    TruePath,
    closure_m,
    effort_rad_s2,
    heading_rms_rad,
    path_rms_m,
    reversals_per_s,
)
from rover_hil.tune.scenarios import with_scenario

CONNECT_TIMEOUT_S = 1.0
OVER = (Mode.FINISHED, Mode.EMERGENCY_STOP)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedMission:
    """Result of one mission.

    Attributes:
        seed: Of scenario and noise.
        refused: Why the gains are rejected; empty when they are acceptable.
        terms: Measured values by the names of the objective.
        reversals_per_s: Reversals of the setpoint of the busiest wheel.
        true_path: True poses.
    """

    seed: int
    refused: str
    terms: Mapping[str, float]
    reversals_per_s: float
    true_path: TruePath


def simulate_mission(config: Config, seed: int) -> SimulatedMission:
    """Drive the mission of `config` on the scenario of `seed`; the same arguments give the same result.

    Raises:
        ConfigError: The configuration has no [mission], no [simulation] or no [tune], or they do not fit.
    """
    if config.mission is None or config.tune is None:
        raise ConfigError("a simulated mission needs [mission] and [tune]: add them")
    driven = drive(with_scenario(config, seed))
    mode, truth, set_points_rad_s = driven.mode, driven.truth, driven.set_points_rad_s
    stability = config.tune.stability
    period_s = 1.0 / config.loop.rate_hz
    reversals = reversals_per_s(set_points_rad_s, period_s, stability.reversal_rad_s)
    refused = ""
    if mode is not Mode.FINISHED:
        words = mode.value.replace("_", " ")
        refused = f"the mission was not finished: mode '{words}' after {truth.t_s[-1]:.0f} s"
    elif reversals > stability.reversals_per_s:
        refused = f"a wheel setpoint reversed {reversals:.2f} times per second"
    corners, true_path = config.mission.corners(), TruePath.of(truth)
    along_path = config.mission.heading != "hold"
    terms = {
        "path_rms_m": path_rms_m(true_path, corners),
        "closure_m": closure_m(true_path, corners),
        "heading_deg": math.degrees(heading_rms_rad(true_path, corners, along_path=along_path)),
        "effort_rad_s2": effort_rad_s2(set_points_rad_s, period_s),
        "duration_s": float(truth.t_s[-1]),
    }
    return SimulatedMission(
        seed=seed, refused=refused, terms=terms, reversals_per_s=reversals, true_path=true_path
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DrivenMission:
    """One run of the loop: last mode, tracks relative to their first pose, setpoints while driving.

    The yaw excitation of a probe is averaged out of the setpoints: it is intended, not an oscillation.
    """

    mode: Mode
    truth: Track
    estimate: Track
    set_points_rad_s: Array


def drive(config: Config) -> DrivenMission:
    """Run the loop on the simulated rover of `config` to its end.

    Raises:
        ConfigError: The configuration has no [simulation], or it does not fit.
    """
    clock = VirtualClock()
    rig, world = build_virtual_rig(without_check_manoeuvre(config), clock, NoTap())
    period_ns = nanoseconds(1.0 / config.loop.rate_hz)
    start_ns = now_ns = clock.now_ns()
    end_ns = start_ns + nanoseconds(config.loop.time_limit_s)
    true_poses: list[tuple[float, ...]] = []
    estimates: list[tuple[float, ...]] = []
    set_points: list[tuple[float, ...]] = []
    mode = Mode.SETTLING
    rig.connect(CONNECT_TIMEOUT_S)
    with closing(rig), _no_search_for_cycles():
        while now_ns < end_ns and mode not in OVER:
            now_ns += period_ns
            clock.sleep_until(now_ns)
            _, output, _ = rig.cycle(now_ns)
            mode = output.mode
            if mode is Mode.RUNNING:
                set_points.append(output.command.speed_rad_s)
            t_s, truth, estimate = seconds(now_ns - start_ns), world.plant.truth(), output.estimate
            true_poses.append((t_s, truth.x_m, truth.y_m, truth.yaw_rad))
            estimates.append((t_s, estimate.x_m, estimate.y_m, estimate.yaw_rad))
    return DrivenMission(
        mode=mode,
        truth=Track.of(np.array(true_poses)).from_first_pose(),
        estimate=Track.of(np.array(estimates)),
        set_points_rad_s=_without_yaw_excitation(config, np.array(set_points)),
    )


@contextmanager
def _no_search_for_cycles() -> Iterator[None]:
    """Stop Python's search for objects that refer to each other: a run makes hardly any, and it takes 5 %."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _without_yaw_excitation(config: Config, set_points_rad_s: Array) -> Array:
    """Return the setpoints averaged over one period of the yaw excitation where there is one."""
    slip = config.slip
    if slip is None or slip.use != YAW_PROBE:
        return set_points_rad_s
    cycles = max(1, round(config.loop.rate_hz / slip.excitation.frequency_hz))
    if len(set_points_rad_s) < cycles:
        return set_points_rad_s
    sums = np.cumsum(np.vstack((np.zeros(set_points_rad_s.shape[1]), set_points_rad_s)), axis=0)
    averaged: Array = (sums[cycles:] - sums[:-cycles]) / cycles
    return averaged
