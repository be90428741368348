# ruff: noqa: C901, D101, D403, E501 (kept as its author wrote it)
"""Reference fit of odometry parameters on the optiodom circle drives.

Method
------
Wheel readings are integrated to a path of the robot's centre (mid-point heading rule).  Over stretches of
about 2 m of true path (a new one each 0.5 m) the relative motion of the truth's marker,
``T_i^-1 T_j``, is compared with the relative motion predicted from the wheels, ``M^-1 (O_i^-1 O_j) M``, where
M = (x, y, yaw) is the marker's place on the robot.  Weighted least squares (weights from the residuals' own
spread, position and yaw apart) over all stretches of all runs of a robot gives all parameters at once.

The clocks of truth and wheels are aligned first: per run an offset and a rate between the two clocks are found by
matching turned angle and travelled length; they are nuisance values, reported but not among the parameters.

95 % intervals: bootstrap over whole runs, drawn anew within each kind of drive (direction of turn, direction of
motion), 2000 draws, each solved by one Gauss-Newton step from the full solution, spread enlarged by
sqrt(n/(n-1)) for the n runs of the smallest kind.  It holds the repeatability only.  What depends on choices
is in ``low_model``/``high_model``: the hull over the interval and other fits: stretches of 0.5, 1, 4 m; from the
start to each point of the run; first and second halves of the runs; odd and even runs; no clock alignment; and where
there are several: each session, and without each of more than two kinds of drive.

``determined``: the model hull is narrower than a quarter of the prior range AND both pairs of halves agree within a
tenth of the prior range.  ``differs_from_nominal``: nominal outside the model hull (``outside_95``: outside the plain
interval; the README says which to believe).  The prior ranges are stated in ``PRIOR``.

Assumptions
-----------
No slip beyond what constants can absorb; planar motion; one marker place per robot; rear axle (tricycle), axle
middle (differential), and centre of the three wheels (omni3) are the robot's origin, x ahead; columns as the data's
README has them.  omni3
wheel directions follow from the data: wheel rim speed = (-sqrt3/2 vx - vy/2 - L w, +sqrt3/2 vx - vy/2 - L w,
vy - L w).  The tricycle's steering gain is taken as 1 (only gain / wheelbase is visible on circles).

Usage: python -m benchmarks.gap_machines.reference_fit DATA [OUT_JSON]   (DATA holds vehicles/optiodom or is it)
"""

from __future__ import annotations

import csv
import gzip
import io
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]
SEED = 20240611
DRAWS = 2000
STRETCH = 2.0
ALTERNATIVE_STRETCHES = (0.5, 1.0, 4.0)


@dataclass
class Run:
    """One drive: wheel readings with the truth's pose at the same (aligned) times."""

    name: str
    session: str
    kind: str
    t: Array
    truth: Array  # x, y, yaw (unwrapped), raw clock
    wheels: Array  # increments per cycle (and steering angle)
    meta: dict[str, list[float]]
    clock: tuple[float, float] = (0.0, 0.0)
    aligned: Array = field(default_factory=lambda: np.zeros((0, 3)))


Model = Callable[[Array, Array, Run], tuple[Array, Array, Array]]


def read_meta(path: Path) -> dict[str, list[float]]:
    """Numbers of a metadata file, by their key."""
    out: dict[str, list[float]] = {}
    with gzip.open(path, "rt") as handle:
        for row in csv.reader(handle):
            try:
                out[row[0]] = [float(v) for v in row[1:] if v]
            except ValueError:
                continue
    return out


def read_runs(folder: Path) -> list[Run]:
    """All runs below the ``circular`` folder of a robot."""
    runs: list[Run] = []
    for path in sorted(folder.glob("*/*_run-??.csv.gz")):
        with gzip.open(path, "rt") as handle:
            data = np.loadtxt(io.StringIO(handle.read()), delimiter=",")
        truth = data[:, 1:4].copy()
        truth[:, 2] = np.unwrap(truth[:, 2])
        session = path.parent.name
        meta = read_meta(path.parent / f"{session}_metadata.csv.gz")
        turn = "left" if truth[-1, 2] > 0 else "right"
        step = 20
        heading = (
            np.arctan2(*(truth[step:, 1::-1] - truth[:-step, 1::-1]).T) - truth[step // 2 : -step // 2, 2]
        )
        far = np.hypot(*(truth[step:, :2] - truth[:-step, :2]).T) > 0.02
        mean = float(np.angle(np.mean(np.exp(1j * heading[far]))))
        way = "ahead" if abs(mean) < np.pi / 4 else "sideways"
        runs.append(Run(path.name[:-7], session, f"{way}-{turn}", data[:, 0], truth, data[:, 4:], meta))
    return runs


def metres_per_tick(run: Run, radius: float) -> float:
    return float(2 * np.pi * radius / (run.meta["ngear"][0] * run.meta["encRes"][0]))


def diff_model(p: Array, wheels: Array, run: Run) -> tuple[Array, Array, Array]:
    """p = mean radius, (rR - rL) / mean, track."""
    k = metres_per_tick(run, p[0])
    right, left = k * (1 + p[1] / 2) * wheels[:, 0], k * (1 - p[1] / 2) * wheels[:, 1]
    return (right + left) / 2, np.zeros(len(wheels)), (right - left) / p[2]


def omni_model(p: Array, wheels: Array, run: Run) -> tuple[Array, Array, Array]:
    """p = mean radius, (r1 - r2) / mean, (r3 - (r1 + r2) / 2) / mean, centre-to-wheel distance."""
    k = metres_per_tick(run, p[0])
    w1 = k * (1 + p[1] / 2 - p[2] / 3) * wheels[:, 0]
    w2 = k * (1 - p[1] / 2 - p[2] / 3) * wheels[:, 1]
    w3 = k * (1 + 2 * p[2] / 3) * wheels[:, 2]
    return (w2 - w1) / np.sqrt(3), (2 * w3 - w1 - w2) / 3, -(w1 + w2 + w3) / (3 * p[3])


def tricycle_model(p: Array, wheels: Array, run: Run) -> tuple[Array, Array, Array]:
    """p = radius of the driven wheel, wheelbase, steering offset (added to the reading)."""
    travel = metres_per_tick(run, p[0]) * wheels[:, 0]
    angle = wheels[:, 1] + p[2]
    return travel * np.cos(angle), np.zeros(len(wheels)), travel * np.sin(angle) / p[1]


MODELS: dict[str, Model] = {"diff": diff_model, "omni3": omni_model, "tricyc": tricycle_model}
NAMES: dict[str, list[str]] = {
    "diff": ["wheel_radius_m", "radius_difference_right_left_rel", "track_m"],
    "omni3": ["wheel_radius_m", "radius_difference_1_2_rel", "radius_difference_3_rel", "centre_to_wheel_m"],
    "tricyc": ["wheel_radius_m", "wheelbase_m", "steering_offset_rad"],
}
MARKER = ["marker_x_m", "marker_y_m", "marker_yaw_rad"]
#: half width of the range thought possible beforehand: absolute, or relative to nominal for "rel:" entries
PRIOR: dict[str, tuple[str, float]] = {
    "wheel_radius_m": ("rel", 0.10),
    "track_m": ("rel", 0.15),
    "centre_to_wheel_m": ("rel", 0.15),
    "wheelbase_m": ("rel", 0.15),
    "radius_difference_right_left_rel": ("abs", 0.03),
    "radius_difference_1_2_rel": ("abs", 0.03),
    "radius_difference_3_rel": ("abs", 0.03),
    "steering_offset_rad": ("abs", 0.10),
    "marker_x_m": ("abs", 0.10),
    "marker_y_m": ("abs", 0.10),
    "marker_yaw_rad": ("abs", 0.15),
    "curvature_per_steering_1_per_m_rad": ("rel", 0.15),
    "curvature_left_at_0.1963_1_per_m": ("rel", 0.30),
    "curvature_right_at_0.1963_1_per_m": ("rel", 0.30),
}


def nominal(robot: str, run: Run) -> list[float | None]:
    radius, length = run.meta["Di"][0] / 2, run.meta["Li"][0]
    base: dict[str, list[float | None]] = {
        "diff": [radius, 0.0, length],
        "omni3": [radius, 0.0, 0.0, length],
        "tricyc": [radius, length, 0.0],
    }
    return [*base[robot], None, None, None]


def integrate(steps: tuple[Array, Array, Array]) -> Array:
    """Path of the robot from its steps in its own frame; row 0 of a run is the start."""
    forward, side, turn = (s.copy() for s in steps)
    forward[0] = side[0] = turn[0] = 0.0
    yaw = np.cumsum(turn)
    mid = yaw - turn / 2
    x = np.cumsum(forward * np.cos(mid) - side * np.sin(mid))
    y = np.cumsum(forward * np.sin(mid) + side * np.cos(mid))
    return np.column_stack([x, y, yaw])


def relative(a: Array, b: Array) -> Array:
    """Pose b seen from pose a."""
    d = b - a
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    return np.column_stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1], d[:, 2]])


def through_marker(rel: Array, m: Array) -> Array:
    """M^-1 rel M: the motion of the marker for a motion of the robot."""
    c, s = np.cos(rel[:, 2]), np.sin(rel[:, 2])
    dx = rel[:, 0] + c * m[0] - s * m[1] - m[0]
    dy = rel[:, 1] + s * m[0] + c * m[1] - m[1]
    cm, sm = np.cos(m[2]), np.sin(m[2])
    return np.column_stack([cm * dx + sm * dy, -sm * dx + cm * dy, rel[:, 2]])


def truth_at(run: Run, times: Array) -> Array:
    return np.column_stack([np.interp(times, run.t, run.truth[:, i]) for i in range(3)])


def path_length(xy: Array, stride: int) -> Array:
    """Travelled length from chords over ``stride`` rows (noise of single rows would lengthen it)."""
    knots = np.unique(np.r_[np.arange(0, len(xy), stride), len(xy) - 1])
    length = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy[knots], axis=0).T))]
    out: Array = np.interp(np.arange(len(xy)), knots, length)
    return out


def align_clock(run: Run, model: Model, start: Array) -> tuple[float, float]:
    """Offset a and rate b so that truth at a + (1 + b) t fits the wheels at t, by angle and length (scales free)."""
    odo = integrate(model(start, run.wheels, run))
    stride = 10
    odo_len = path_length(odo[:, :2], stride)
    true_len = path_length(run.truth[:, :2], stride)
    weight = abs(odo[-1, 2]) / odo_len[-1]
    channels = [(run.truth[:, 2], odo[:, 2], 1.0), (true_len, odo_len, weight)]

    def misfit(offset: float, rate: float) -> float:
        at = offset + (1 + rate) * run.t
        inside = (at >= 0) & (at <= run.t[-1])
        total = 0.0
        for true, wheels, factor in channels:
            y = np.interp(at[inside], run.t, true) * factor
            x = wheels[inside] - wheels[inside].mean()
            y -= y.mean()
            total += float(np.mean((y - (x @ y) / (x @ x) * x) ** 2))
        return total

    best = (np.inf, 0.0, 0.0)
    for rates, offsets in (
        (np.arange(-0.04, 0.0401, 0.0025), np.arange(-1.6, 1.61, 0.1)),
        (np.arange(-0.0025, 0.00251, 0.0005), np.arange(-0.1, 0.101, 0.02)),
    ):
        centre = best[1:]
        for rate in rates:
            for offset in offsets:
                a, b = centre[0] + float(offset), centre[1] + float(rate)
                best = min(best, (misfit(a, b), a, b))
    return best[1], best[2]


def pairs(run: Run, stretch: float | None, half: int | None) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows at which stretches start and end; stretch None: from the start of the run to each 0.5 m."""
    at = run.clock[0] + (1 + run.clock[1]) * run.t
    ok = np.flatnonzero((at >= 0) & (at <= run.t[-1]))
    length = path_length(run.aligned[:, :2], 10)
    lo, hi = float(length[ok[0]]), float(length[ok[-1]])
    if half is not None:
        lo, hi = (lo, (lo + hi) / 2) if half == 0 else ((lo + hi) / 2, hi)
    if stretch is None:
        end = np.searchsorted(length[ok], np.arange(lo + 0.5, hi, 0.5))
        return np.full(len(end), ok[int(np.searchsorted(length[ok], lo))]), ok[end]
    begin = np.arange(lo, hi - stretch + 1e-9, min(0.5, stretch / 2))
    i = np.searchsorted(length[ok], begin)
    j = np.searchsorted(length[ok], begin + stretch - 1e-9)
    j = np.minimum(j, len(ok) - 1)
    return ok[i], ok[j]


@dataclass
class Solution:
    p: Array
    sigma: tuple[float, float]
    jacobians: list[Array]
    residuals: list[Array]


def residual_run(p: Array, run: Run, model: Model, index: tuple[Any, Any]) -> Array:
    odo = integrate(model(p[:-3], run.wheels, run))
    i, j = index
    got = relative(run.aligned[i], run.aligned[j])
    return got - through_marker(relative(odo[i], odo[j]), p[-3:])


def solve(
    runs: list[Run], model: Model, start: Array, stretch: float | None = STRETCH, half: int | None = None
) -> Solution:
    index = [pairs(r, stretch, half) for r in runs]
    sigma = (0.02, 0.02)
    p = start.copy()

    def weighted(q: Array) -> Array:
        parts = [
            residual_run(q, r, model, ix) / [sigma[0], sigma[0], sigma[1]]
            for r, ix in zip(runs, index, strict=True)
        ]
        return np.concatenate([part.ravel() for part in parts])

    for _ in range(3):
        p = least_squares(weighted, p, x_scale=np.maximum(np.abs(start), 0.02), method="trf").x
        rest = np.concatenate([residual_run(p, r, model, ix) for r, ix in zip(runs, index, strict=True)])
        sigma = (
            max(float(np.sqrt(np.mean(rest[:, :2] ** 2))), 1e-4),
            max(float(np.sqrt(np.mean(rest[:, 2] ** 2))), 1e-4),
        )
    scale = np.array([sigma[0], sigma[0], sigma[1]])
    base = [(residual_run(p, r, model, ix) / scale).ravel() for r, ix in zip(runs, index, strict=True)]
    jac = [np.zeros((len(b), len(p))) for b in base]
    for k in range(len(p)):
        h = 1e-5
        q = p.copy()
        q[k] += h
        for n, (r, ix) in enumerate(zip(runs, index, strict=True)):
            jac[n][:, k] = ((residual_run(q, r, model, ix) / scale).ravel() - base[n]) / h
    return Solution(p, sigma, jac, base)


def bootstrap(sol: Solution, runs: list[Run], rng: np.random.Generator) -> Array:
    """Parameter vectors of DRAWS draws of runs within their kinds."""
    normal = np.array([j.T @ j for j in sol.jacobians])
    right = np.array([j.T @ r for j, r in zip(sol.jacobians, sol.residuals, strict=True)])
    kinds = sorted({r.kind for r in runs})
    members = [np.array([i for i, r in enumerate(runs) if r.kind == k]) for k in kinds]
    widen = float(np.sqrt(min(len(m) for m in members) / (min(len(m) for m in members) - 1)))
    out = np.empty((DRAWS, len(sol.p)))
    for d in range(DRAWS):
        pick = np.concatenate([rng.choice(m, len(m)) for m in members])
        out[d] = sol.p - widen * np.linalg.solve(normal[pick].sum(0), right[pick].sum(0))
    return out


def derived(robot: str, p: Array) -> Array:
    """Fitted parameters, and for the tricycle the curvature per steering command behind them."""
    if robot != "tricyc":
        return p
    left = np.tan(0.1963 + p[2]) / p[1]
    right = np.tan(-0.1963 + p[2]) / p[1]
    return np.concatenate([p, [(left - right) / (2 * 0.1963), left, right]])


REASONS: dict[str, str] = {
    "diff": "one radius of circle only (both turns): six numbers fix six values, so no redundancy tests the model; "
    "scrub of the tyres goes into the track",
    "omni3": "circles of one curvature range, four ways of motion; roller slip goes into radius and distance",
    "tricyc": "only gain / wheelbase is visible; a play of the steering or a wheel set aside looks like the offset",
}


def fit_robot(robot: str, folder: Path) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
    rng = np.random.default_rng(SEED)
    runs = read_runs(folder)
    model = MODELS[robot]
    nom = nominal(robot, runs[0])
    start = np.array([0.0 if v is None else v for v in nom])
    for run in runs:
        run.aligned = run.truth.copy()
    raw = solve(runs, model, start)
    for run in runs:
        run.clock = align_clock(run, model, raw.p[:-3])
        run.aligned = truth_at(run, run.clock[0] + (1 + run.clock[1]) * run.t)
    best = solve(runs, model, start)
    draws = np.array([derived(robot, d) for d in bootstrap(best, runs, rng)])

    alternatives: dict[str, Array] = {"no clock alignment": raw.p}
    for stretch in ALTERNATIVE_STRETCHES:
        alternatives[f"stretch {stretch} m"] = solve(runs, model, start, stretch).p
    alternatives["whole runs"] = solve(runs, model, start, None).p
    halves = {h: solve(runs, model, start, half=h).p for h in (0, 1)}
    alternatives["first halves"], alternatives["second halves"] = halves[0], halves[1]
    order: dict[str, int] = {}
    parity: list[list[Run]] = [[], []]
    for run in runs:
        order[run.kind] = order.get(run.kind, -1) + 1
        parity[order[run.kind] % 2].append(run)
    alternatives["even runs"] = solve(parity[0], model, start).p
    alternatives["odd runs"] = solve(parity[1], model, start).p
    sessions = sorted({r.session for r in runs})
    if len(sessions) > 1:
        for s in sessions:
            alternatives[f"session {s}"] = solve([r for r in runs if r.session == s], model, start).p

    kinds = sorted({r.kind for r in runs})
    if len(kinds) > 2:
        for k in kinds:
            alternatives[f"without {k}"] = solve([r for r in runs if r.kind != k], model, start).p

    names = NAMES[robot] + MARKER
    nominals: list[float | None] = list(nom)
    if robot == "tricyc":
        names = [
            *names,
            "curvature_per_steering_1_per_m_rad",
            "curvature_left_at_0.1963_1_per_m",
            "curvature_right_at_0.1963_1_per_m",
        ]
        nd = derived(robot, start)[-3:]
        nominals += [float(v) for v in nd]
    estimate = derived(robot, best.p)
    alt = {k: derived(robot, v) for k, v in alternatives.items()}
    table: dict[str, dict[str, Any]] = {}
    for n, name in enumerate(names):
        low, high = (float(v) for v in np.percentile(draws[:, n], [2.5, 97.5]))
        values = [float(v[n]) for v in alt.values()]
        low_model, high_model = min([low, *values]), max([high, *values])
        kind, width = PRIOR[name]
        nominal_value = nominals[n]
        half_prior = width * abs(nominal_value) if kind == "rel" and nominal_value else width
        gap = max(
            abs(float(alt["first halves"][n] - alt["second halves"][n])),
            abs(float(alt["odd runs"][n] - alt["even runs"][n])),
        )
        narrow = (high_model - low_model) < 0.25 * 2 * half_prior
        stable = gap < 0.1 * 2 * half_prior
        outside_95 = nominal_value is not None and not low <= nominal_value <= high
        outside = nominal_value is not None and not low_model <= nominal_value <= high_model
        widest = max(alt, key=lambda k: abs(float(alt[k][n]) - float(estimate[n])))
        why = (
            f"hull {low_model:.5g}..{high_model:.5g} of prior range +-{half_prior:.3g}; halves differ by {gap:.2g}; "
            f"largest change by '{widest}' ({float(alt[widest][n] - estimate[n]):+.2g}); "
        )
        if nominal_value is None:
            why += (
                "no nominal given (0 "
                + ("outside" if not low_model <= 0 <= high_model else "inside")
                + " the hull)"
            )
        else:
            why += (
                "nominal outside the hull"
                if outside
                else "nominal outside the interval but inside the hull"
                if outside_95
                else "nominal inside"
            )
        table[name] = {
            "nominal": nominal_value,
            "estimate": float(estimate[n]),
            "low95": low,
            "high95": high,
            "determined": bool(narrow and stable),
            "differs_from_nominal": bool(outside),
            "outside_95": bool(outside_95),
            "low_model": low_model,
            "high_model": high_model,
            "why": why + "; " + REASONS[robot],
        }
    clock_rate = np.array([r.clock[1] for r in runs])
    clock_offset = np.array([r.clock[0] for r in runs])
    extra: dict[str, Any] = {
        "runs": len(runs),
        "residual_position_m": best.sigma[0],
        "residual_yaw_rad": best.sigma[1],
        "residual_no_clock_alignment": raw.sigma,
        "clock_rate_mean": float(clock_rate.mean()),
        "clock_rate_sd": float(clock_rate.std()),
        "clock_offset_mean_s": float(clock_offset.mean()),
        "clock_offset_sd_s": float(clock_offset.std()),
        "condition_of_scaled_normal_matrix": condition(best),
    }
    nominal_fit = np.concatenate(
        [residual_run(np.r_[start[:-3], best.p[-3:]], r, model, pairs(r, STRETCH, None)) for r in runs]
    )
    extra["residual_with_nominal"] = [
        float(np.sqrt(np.mean(nominal_fit[:, :2] ** 2))),
        float(np.sqrt(np.mean(nominal_fit[:, 2] ** 2))),
    ]
    by_kind: dict[str, list[float]] = {}
    for kind_name in kinds:
        some = [r for r in runs if r.kind == kind_name]
        rest = np.concatenate([residual_run(best.p, r, model, pairs(r, STRETCH, None)) for r in some])
        turn = np.concatenate(
            [relative(r.aligned[a], r.aligned[b])[:, 2] for r in some for a, b in [pairs(r, STRETCH, None)]]
        )
        by_kind[kind_name] = [float(v) for v in [*rest[:, :2].mean(0), rest[:, 2].sum() / turn.sum()]]
    extra["mean_residual_by_kind_x_m_y_m_yaw_rel"] = by_kind
    return table, extra


def condition(sol: Solution) -> float:
    normal = sum(j.T @ j for j in sol.jacobians)
    d = 1 / np.sqrt(np.diag(normal))
    return float(np.linalg.cond(normal * d[:, None] * d[None, :]))


def main(argv: list[str]) -> int:
    if len(argv) < 2:
        print(__doc__)
        return 2
    data = Path(argv[1])
    for sub in ("vehicles/optiodom", "optiodom"):
        if (data / sub).is_dir():
            data = data / sub
    out = Path(argv[2]) if len(argv) > 2 else Path(__file__).with_name("results.json")
    results: dict[str, dict[str, dict[str, Any]]] = {}
    extras: dict[str, dict[str, Any]] = {}
    for robot in MODELS:
        table, extra = fit_robot(robot, data / robot / "circular")
        results[robot], extras[robot] = table, extra
        print(
            f"\n{robot}: {extra['runs']} runs, residual of {STRETCH} m: {1000 * extra['residual_position_m']:.1f} mm, "
            f"{extra['residual_yaw_rad']:.4f} rad (nominal: {1000 * extra['residual_with_nominal'][0]:.1f} mm, "
            f"{extra['residual_with_nominal'][1]:.4f} rad); truth's clock against the wheels': "
            f"{100 * extra['clock_rate_mean']:+.2f} % (sd {100 * extra['clock_rate_sd']:.2f}), "
            f"{extra['clock_offset_mean_s']:+.3f} s (sd {extra['clock_offset_sd_s']:.3f})"
        )
        print(
            f"  {'parameter':38s} {'nominal':>9s} {'estimate':>9s} {'95 % interval':>21s} {'hull':>21s} determ. differs"
        )
        for name, row in table.items():
            nom_text = "-" if row["nominal"] is None else f"{row['nominal']:.5f}"
            print(
                f"  {name:38s} {nom_text:>9s} {row['estimate']:9.5f} {row['low95']:10.5f} {row['high95']:10.5f} "
                f"{row['low_model']:10.5f} {row['high_model']:10.5f} {row['determined']!s:7s} "
                f"{row['differs_from_nominal']}"
            )
    out.write_text(json.dumps(results, indent=1) + "\n")
    out.with_name("extras.json").write_text(json.dumps(extras, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv))
