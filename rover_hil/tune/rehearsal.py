"""One mission on the simulated rover, as fast as the machine allows: no log, only what it came to."""

import math
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from controllers.motion.mission import corner_points
from controllers.safety import Mode
from controllers.slip.effort.settings import YAW_PROBE
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.errors import ConfigError
from drivers.link import NoTap
from rover_hil.config import Config
from rover_hil.report.tracks import Array, Track
from rover_hil.run.composition import build_virtual_rig
from rover_hil.tune.metrics import (
    Way,
    closure_m,
    effort_rad_s2,
    heading_rms_rad,
    path_rms_m,
    reversals_per_s,
)
from rover_hil.tune.sites import at_site

CONNECT_TIMEOUT_S = 1.0
OVER = (Mode.FINISHED, Mode.EMERGENCY_STOP)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rehearsal:
    """What one mission came to.

    Attributes:
        seed: Of site and noise.
        refused: Why gains that do this are not acceptable; empty when they are.
        terms: What the objective may count, by its names there.
        reversals_per_s: How often the busiest wheel's set-point turned round.
        way: Where the rover really was.
    """

    seed: int
    refused: str
    terms: Mapping[str, float]
    reversals_per_s: float
    way: Way


def rehearse(config: Config, seed: int) -> Rehearsal:
    """Drive the mission of `config` once on the site of `seed`; the same arguments give the same result.

    Raises:
        ConfigError: The configuration has no [mission], no [simulation] or no [tune], or they do not fit.
    """
    if config.mission is None or config.tune is None:
        raise ConfigError("a rehearsal needs [mission] and [tune]: add them")
    driven = drive(at_site(config, seed))
    mode, truth, set_points_rad_s = driven.mode, driven.truth, driven.set_points_rad_s
    stability = config.tune.stability
    period_s = 1.0 / config.loop.rate_hz
    reversals = reversals_per_s(set_points_rad_s, period_s, stability.reversal_rad_s)
    refused = ""
    if mode is not Mode.FINISHED:
        refused = f"the mission was not finished, the rover was {mode.value} after {truth.t_s[-1]:.0f} s"
    elif reversals > stability.reversals_per_s:
        refused = f"a wheel set-point turned round {reversals:.2f} times per second"
    corners, way = corner_points(config.mission), Way.of(truth)
    along_path = config.mission.heading == "along_path"
    terms = {
        "path_rms_m": path_rms_m(way, corners),
        "closure_m": closure_m(way, corners),
        "heading_deg": math.degrees(heading_rms_rad(way, corners, along_path=along_path)),
        "effort_rad_s2": effort_rad_s2(set_points_rad_s, period_s),
        "duration_s": float(truth.t_s[-1]),
    }
    return Rehearsal(seed=seed, refused=refused, terms=terms, reversals_per_s=reversals, way=way)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """One run of the loop: last mode, tracks from their own first pose, set-points while driving.

    The shake of a yaw probe is averaged out of the set-points: it is wanted, and no sign of bad gains.
    """

    mode: Mode
    truth: Track
    estimate: Track
    set_points_rad_s: Array


def drive(config: Config) -> Drive:
    """Run the loop on the simulated rover of `config` to its end.

    Raises:
        ConfigError: The configuration has no [simulation], or it does not fit.
    """
    clock = VirtualClock()
    rig, world = build_virtual_rig(config, clock, NoTap())
    period_ns = nanoseconds(1.0 / config.loop.rate_hz)
    start_ns = now_ns = clock.now_ns()
    end_ns = start_ns + nanoseconds(config.loop.time_limit_s)
    true_poses: list[tuple[float, ...]] = []
    estimates: list[tuple[float, ...]] = []
    set_points: list[tuple[float, ...]] = []
    mode = Mode.SETTLING
    rig.connect(CONNECT_TIMEOUT_S)
    with closing(rig):
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
    return Drive(
        mode=mode,
        truth=Track.of(np.array(true_poses)).from_first_pose(),
        estimate=Track.of(np.array(estimates)),
        set_points_rad_s=_without_shake(config, np.array(set_points)),
    )


def _without_shake(config: Config, set_points_rad_s: Array) -> Array:
    """Return the set-points averaged over one period of the yaw probe's shake where there is one."""
    slip = config.slip
    if slip is None or slip.use != YAW_PROBE or slip.maps.yaw_probe is None:
        return set_points_rad_s
    cycles = max(1, round(config.loop.rate_hz / slip.maps.yaw_probe.frequency_hz))
    if len(set_points_rad_s) < cycles:
        return set_points_rad_s
    sums = np.cumsum(np.vstack((np.zeros(set_points_rad_s.shape[1]), set_points_rad_s)), axis=0)
    averaged: Array = (sums[cycles:] - sums[:-cycles]) / cycles
    return averaged
