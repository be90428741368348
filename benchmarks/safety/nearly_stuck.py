"""Nearly stuck rovers on sites of seven contact laws (`tests/nature/nearly_stuck`), by the excitation alone.

    python -m benchmarks.safety.nearly_stuck [--first 100] [--sites 5]

The Robotino drives a line of 2 m at 0.15 m/s. After 0.2 to 0.7 m the ground changes: to one on which it slips
by 0.90 to 0.985 (stuck), or by 0.02 to 0.70 (healthy). Nothing measures the position, and the constants of
the gyro are unknown.

Columns: travel of the wheels from the change until the slip is reported as unknown, and the true slip of the
1.5 s before; share of the cycles in the 95 % region (x, y and yaw), and whether the end is; error at the end
of the estimate and of the encoders, mm; travel of the wheels, m. Exit code 1 where a bar of the last lines is
missed: unknown within 0.5 m, 95 % of the stuck sites; ends in the region, 95 %; 90 % quantile of the error at
the end at most 1.5 times the encoders' and 20 mm; of the sites that slip by at most 0.5, 1 % reported.
"""

import argparse
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.gates.floors import configure_version
from benchmarks.safety.missions import Driven, Moment, drive
from controllers.motion.settings import LineMission
from controllers.slip.effort.ground_knowledge import SlipSource
from rover_hil.parallel.executor import open_executor
from tests.nature.nearly_stuck import LAWS, Site, draw_healthy, draw_stuck

LENGTH_M, SPEED_M_S, LIMIT_S = 2.0, 0.15, 60.0
BEFORE_S = 1.5
WITHIN_M, LEAST_SHARE, GREATEST_RATIO, SLACK_M, MOST_FLAGGED = 0.5, 0.95, 1.5, 0.020, 0.01
HEALTHY_SLIP = 0.5
REGION_95 = 7.815
"""Squared error over its covariance, of three dimensions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of a rover on a site."""

    site: Site
    after_m: float | None
    slip_then: float
    inside: float
    ends_inside: bool
    error_m: float
    encoders_m: float
    rolled_m: float
    end: str


def try_site(kind: str, law: str, seed: int) -> Outcome:
    """Drive on a site; the same arguments give the same outcome."""
    site = (draw_stuck if kind == "stuck" else draw_healthy)(law, seed)
    mission = LineMission(type="line", length_m=LENGTH_M, speed_m_s=SPEED_M_S)
    config = configure_version("shipped", seed).model_copy(update={"mission": mission})
    return _judge(site, drive(config, limit_s=LIMIT_S, make_plant=site.plant))


def _judge(site: Site, driven: Driven) -> Outcome:
    moments = driven.moments
    true_m = np.array([complex(*each.truth[:2]) for each in moments])
    wheels_m = np.array([complex(each.output.odometry.x_m, each.output.odometry.y_m) for each in moments])
    rolled_m, moved_m = (np.concatenate(([0.0], np.abs(np.diff(way)).cumsum())) for way in (wheels_m, true_m))
    changed = int(np.argmax(np.abs(true_m) >= site.at_m))
    flagged = next((k for k in range(changed, len(moments)) if _is_unknown(moments[k])), None)
    slip_then = float("nan")
    if flagged is not None:
        begin = next(k for k in range(flagged + 1) if moments[k].t_s >= moments[flagged].t_s - BEFORE_S)
        slip_then = 1.0 - (moved_m[flagged] - moved_m[begin]) / max(rolled_m[flagged] - rolled_m[begin], 1e-6)
    last = moments[-1]
    nees = np.array([each.nees for each in moments])
    return Outcome(
        site=site,
        after_m=None if flagged is None else float(rolled_m[flagged] - rolled_m[changed]),
        slip_then=slip_then,
        inside=float(np.mean(nees <= REGION_95)),
        ends_inside=bool(nees[-1] <= REGION_95),
        error_m=abs(complex(last.output.estimate.x_m, last.output.estimate.y_m) - true_m[-1]),
        encoders_m=abs(wheels_m[-1] - true_m[-1]),
        rolled_m=float(rolled_m[-1]),
        end=f"{driven.mode} {last.output.reason[:40]}",
    )


def _is_unknown(moment: Moment) -> bool:
    report = moment.output.slip
    return report is not None and report.rover is not None and report.rover.source is SlipSource.UNKNOWN


def main() -> int:
    """Print the outcomes; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=100, help="seed of the first site of each law")
    parser.add_argument("--sites", type=int, default=5, help="of each kind and law")
    arguments = parser.parse_args()
    console, seeds = Console(width=150), range(arguments.first, arguments.first + arguments.sites)
    jobs = [(kind, law, seed) for kind in ("stuck", "healthy") for law in LAWS for seed in seeds]
    with open_executor(None) as pool:
        outcomes = list(
            track(pool.map(try_site, *zip(*jobs, strict=True)), total=len(jobs), console=Console(stderr=True))
        )
    table = Table(
        "site", "slip", "uneven", "unknown after", "slip then", "inside", "error", "wheels", "m", "end"
    )
    for (kind, law, seed), found in zip(jobs, outcomes, strict=True):
        table.add_row(
            f"{kind} {law} {seed}",
            f"{found.site.steady_slip:.2f}",
            "yes" if found.site.uneven else "",
            "never" if found.after_m is None else f"{found.after_m:.2f} m",
            f"{found.slip_then:.2f}",
            f"{found.inside:.2f}{'' if found.ends_inside else ', not at the end'}",
            f"{1e3 * found.error_m:.0f}",
            f"{1e3 * found.encoders_m:.0f}",
            f"{found.rolled_m:.1f}",
            found.end,
        )
    console.print(table)
    return int(not _report(outcomes[: len(jobs) // 2], outcomes[len(jobs) // 2 :], console))


def _report(stuck: list[Outcome], healthy: list[Outcome], console: Console) -> bool:
    """Print the bars; return whether they are met."""
    soon = sum(each.after_m is not None and each.after_m <= WITHIN_M for each in stuck)
    inside = sum(each.ends_inside for each in stuck)
    error_m, encoders_m = (
        float(np.quantile(values, 0.9))
        for values in ([each.error_m for each in stuck], [each.encoders_m for each in stuck])
    )
    sound = [each for each in healthy if each.site.steady_slip <= HEALTHY_SLIP]
    # A healthy site on which a rover gets stuck after all is not sound.
    flagged = [each for each in sound if each.after_m is not None and each.slip_then <= HEALTHY_SLIP]
    console.print(f"unknown within {WITHIN_M:g} m: {soon} of {len(stuck)}; ends inside: {inside}")
    console.print(
        f"90 % of the errors at the end: {1e3 * error_m:.0f} mm, encoders {1e3 * encoders_m:.0f} mm"
    )
    console.print(
        f"sites that slip by at most {HEALTHY_SLIP:g} and are reported: {len(flagged)} of {len(sound)}"
    )
    return (
        min(soon, inside) >= LEAST_SHARE * len(stuck)
        and error_m <= GREATEST_RATIO * encoders_m + SLACK_M
        and len(flagged) <= MOST_FLAGGED * len(sound)
    )


if __name__ == "__main__":
    raise SystemExit(main())
