"""Slip by the yaw excitation on floors of `tests/nature`: paths against the encoders', and errors.

    python -m benchmarks.gates.readings --nature bristle --first 0 --floors 40
    python -m benchmarks.gates.readings --nature tread --gyro "late by 40 ms" --unknown

Each floor is driven with encoders and gyro alone, and with the excitation; both with the same noise. A
reading is compared with the effective slip: the one number for all wheels which, shared among them, gives the
true translation of its window.
"""

import argparse
import cmath
import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.gates.floors import (
    FIRST_FULL_FLOOR,
    FIXES_PER_S,
    NATURE_NAMES,
    Way,
    bracket_weight,
    configure_version,
    drive_config,
)
from benchmarks.safety.missions import Driven, Falsify, Moment, with_fixes
from benchmarks.wilson import share_text
from controllers.motion.kinematics import Kinematics, make_kinematics
from controllers.safety import Mode
from controllers.slip.effort.ground_knowledge import SlipSource
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.slip_sharing import share_slip
from drivers.samples import RateSample, Sample
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor

DELAY_SAMPLES = 2
"""40 ms at 50 Hz."""
LOW_PASS_HZ = 10.0
NAMED = "wheels in place"
"""Part of both sentences by which scale and sign of the gyro are named."""
LEAST_TRAVEL_M = 0.04
"""Of the wheels in a window; slip of less travel is no number."""


class _Late:
    """A gyro whose readings are those of 40 ms before."""

    def __init__(self) -> None:
        self._rates: deque[float] = deque(maxlen=DELAY_SAMPLES + 1)

    def __call__(self, t_s: float, sample: Sample) -> Sample:
        if not isinstance(sample, RateSample):
            return sample
        self._rates.append(sample.rate_z_rad_s)
        return replace(sample, rate_z_rad_s=self._rates[0])


class _LowPass:
    """A gyro with a low-pass of first order."""

    def __init__(self) -> None:
        self._t_s = self._rate_rad_s = 0.0

    def __call__(self, t_s: float, sample: Sample) -> Sample:
        if not isinstance(sample, RateSample):
            return sample
        keep = math.exp(-math.tau * LOW_PASS_HZ * (t_s - self._t_s))
        self._rate_rad_s = sample.rate_z_rad_s + keep * (self._rate_rad_s - sample.rate_z_rad_s)
        self._t_s = t_s
        return replace(sample, rate_z_rad_s=self._rate_rad_s)


class _Half:
    """A gyro that measures half of the turn."""

    def __call__(self, t_s: float, sample: Sample) -> Sample:
        if not isinstance(sample, RateSample):
            return sample
        return replace(sample, rate_z_rad_s=0.5 * sample.rate_z_rad_s)


class _Healthy:
    """A gyro as simulated."""

    def __call__(self, t_s: float, sample: Sample) -> Sample:
        return sample


GYROS: dict[str, Callable[[], Falsify]] = {
    "healthy": _Healthy,
    "late by 40 ms": _Late,
    "low-pass 10 Hz": _LowPass,
    "half scale": _Half,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """How a floor is driven.

    Attributes:
        nature: Name of the contact law.
        gyro: One of `GYROS`.
        is_known: The constants of the gyro are known: those of a healthy one.
        has_fixes: With pose fixes every two seconds.
        weight: Place of the reading in its bracket; 0 for the secant alone.
    """

    nature: str
    gyro: str
    is_known: bool
    has_fixes: bool
    weight: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """One window of the excitation with travel.

    Attributes:
        slip: In use after it.
        sd: Its standard deviation.
        reason: Why it is not valid; empty where it is.
        effective: Slip that gives the true translation.
        duration_s: Of the window.
    """

    slip: float
    sd: float
    reason: str
    effective: float
    duration_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """One floor: the ways without and with the excitation, and its windows."""

    encoders: Way
    excited: Way
    windows: tuple[Window, ...]
    last_reason: str


def try_floor(trial: Trial, seed: int) -> Result:
    """Drive a floor without and with the excitation; the same arguments give the same result."""
    ways, driven, config = [], None, None
    for version in ("encoders and gyro", "calibrated gyro" if trial.is_known else "shipped"):
        config = configure_version(version, seed)
        if trial.has_fixes:
            config = with_fixes(config, FIXES_PER_S)
        with bracket_weight(trial.weight):
            way, driven = drive_config(config, trial.nature, seed, GYROS[trial.gyro]())
        ways.append(way)
    assert driven is not None
    assert config is not None
    return Result(
        encoders=ways[0],
        excited=ways[1],
        windows=tuple(find_windows(config, driven)),
        last_reason=driven.moments[-1].output.reason,
    )


def find_windows(config: Config, driven: Driven) -> Sequence[Window]:
    """Return the windows with travel of a drive."""
    kinematics = make_kinematics(config.rover)
    windows: list[Window] = []
    start: int | None = None
    before: object = None
    for index, moment in enumerate(driven.moments):
        report = moment.output.slip
        rover = None if report is None else report.rover
        if rover is None or moment.output.mode is not Mode.RUNNING:
            start = None
        elif rover is not before:
            if start is not None:
                effective_slip = _effective_slip(kinematics, driven.moments[start : index + 1])
                if effective_slip is not None:
                    is_read = rover.source is SlipSource.EXCITATION
                    windows.append(
                        Window(
                            slip=rover.slip,
                            sd=rover.sd,
                            reason=rover.reason or ("" if is_read else rover.source.value),
                            effective=effective_slip,
                            duration_s=moment.t_s - driven.moments[start].t_s,
                        )
                    )
            start = index
        before = rover
    return windows


def _effective_slip(kinematics: Kinematics, moments: Sequence[Moment]) -> float | None:
    """Return the slip of all wheels that gives the true translation; None with too little travel."""
    travelled_m, turn_rad, true_m = 0j, 0.0, 0j
    for begin, end in pairwise(moments):
        first, last = begin.output.odometry, end.output.odometry
        step_m = complex(last.x_m - first.x_m, last.y_m - first.y_m)
        step_rad = math.remainder(last.yaw_rad - first.yaw_rad, math.tau)
        travelled_m += step_m * cmath.rect(1.0, -first.yaw_rad - 0.5 * step_rad)
        turn_rad += step_rad
        step_m = complex(end.truth[0] - begin.truth[0], end.truth[1] - begin.truth[1])
        true_m += step_m * cmath.rect(1.0, -0.5 * (begin.truth[2] + end.truth[2]))
    if abs(travelled_m) < LEAST_TRAVEL_M:
        return None
    true_rad = moments[-1].truth[2] - moments[0].truth[2]
    turned_rad = kinematics.wheel_speeds(travelled_m.real, travelled_m.imag, turn_rad)
    along = travelled_m / abs(travelled_m)

    def moved_m(slip: float) -> float:
        missing_rad = (1.0 - slip) * turn_rad - true_rad
        slips = share_slip(kinematics, turned_rad, slip, missing_rad)
        rolled_rad = [angle * (1.0 - lost) for angle, lost in zip(turned_rad, slips, strict=True)]
        x_m, y_m, _ = kinematics.body_motion(rolled_rad)
        return (complex(x_m, y_m) * along.conjugate()).real

    # Linear in the slip, away from its ends.
    none_m, half_m = moved_m(0.1), moved_m(0.4)
    return 0.1 + 0.3 * (none_m - (true_m * along.conjugate()).real) / (none_m - half_m)


def row_of(results: Sequence[Result]) -> dict[str, str]:
    """Return the figures of a row."""
    floors = len(results)
    smaller = sum(result.excited.path_m < result.encoders.path_m for result in results)
    named = sum(any(NAMED in window.reason for window in result.windows) for result in results)
    return {
        "floors": f"{floors}",
        "within (encoders)": f"{_within(results)} ({sum(result.encoders.is_within for result in results)})",
        "finished (encoders)": (
            f"{sum(result.excited.has_finished for result in results)} "
            f"({sum(result.encoders.has_finished for result in results)})"
        ),
        "path smaller": share_text(smaller, floors),
        "path mm (encoders)": (
            f"{_median_mm([result.excited.path_m for result in results])} "
            f"({_median_mm([result.encoders.path_m for result in results])})"
        ),
        "gyro named": share_text(named, floors),
        **_readings([window for result in results for window in result.windows]),
    }


def _readings(windows: Sequence[Window]) -> dict[str, str]:
    """Return the errors of the valid readings."""
    read = [window for window in windows if not window.reason]
    if not read:
        return {"valid time": "0.00"}
    errors = np.array([window.slip - window.effective for window in read])
    deviations = np.array([window.sd for window in read])
    total_s = sum(window.duration_s for window in windows)
    return {
        "rms": f"{float(np.sqrt(np.mean(errors**2))):.3f}",
        "bias": f"{errors.mean():+.3f}",
        "within 2 sd": share_text(int(np.sum(np.abs(errors) <= 2.0 * deviations)), len(read)),
        "valid time": f"{sum(window.duration_s for window in read) / total_s:.2f}",
        "median sd": f"{np.median(deviations):.3f}",
    }


def _within(results: Sequence[Result]) -> int:
    return sum(result.excited.is_within for result in results)


def _median_mm(values_m: Sequence[float]) -> str:
    return f"{1e3 * float(np.median(values_m)):.1f}"


def main() -> None:
    """Drive the floors and print a row."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--nature", choices=NATURE_NAMES, default=NATURE_NAMES[0])
    parser.add_argument("--gyro", choices=tuple(GYROS), default="healthy")
    parser.add_argument("--unknown", action="store_true", help="the constants of the gyro are not known")
    parser.add_argument("--fixes", action="store_true")
    parser.add_argument("--weight", type=float, default=EFFORT.bracket.weight, help="0: the secant alone")
    parser.add_argument("--first", type=int, default=FIRST_FULL_FLOOR)
    parser.add_argument("--floors", type=int, default=60)
    parser.add_argument("--each", action="store_true", help="print every floor, too")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    trial = Trial(
        nature=arguments.nature,
        gyro=arguments.gyro,
        is_known=not arguments.unknown,
        has_fixes=arguments.fixes,
        weight=arguments.weight,
    )
    seeds = range(arguments.first, arguments.first + arguments.floors)
    with open_executor(arguments.cluster) as pool:
        of_floors = pool.map(try_floor, [trial] * len(seeds), seeds)
        results = list(track(of_floors, "floors", total=len(seeds), console=Console(stderr=True)))
    if arguments.each:
        for seed, result in zip(seeds, results, strict=True):
            print(seed, _each(result))
    print(f"{trial}, floors {seeds.start} to {seeds.stop - 1}")
    for name, value in row_of(results).items():
        print(f"{name:20}  {value}")


def _each(result: Result) -> str:
    read = [window for window in result.windows if not window.reason]
    errors = [window.slip - window.effective for window in read]
    reasons = sorted({window.reason for window in result.windows if window.reason})
    medians = (
        f"slip {np.median([window.effective for window in read]):.2f}, error {np.mean(errors):+.2f}, "
        f"rms {np.sqrt(np.mean(np.square(errors))):.2f}"
        if read
        else "nothing read"
    )
    ways = [
        f"path {1e3 * way.path_m:.1f} mm, closure {1e3 * way.closure_m:.0f} mm"
        f"{'' if way.has_finished else ', not finished'}"
        for way in (result.encoders, result.excited)
    ]
    return f"{' -> '.join(ways)}; {medians}; {reasons} {result.last_reason[:90]}"


if __name__ == "__main__":
    main()
