"""Fit the curves of each surface over the direction of travel."""

from collections.abc import Sequence

import numpy as np

from controllers.slip.effort.surface_map import DirectionCurve, SurfaceMap, SurfaceModel
from drivers.errors import LogError
from rover_hil.drives.arrays import Array, Flags
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import RunWindows


def travel_work_j(run: RunWindows) -> Array:
    """Return the work of the wheels in each window."""
    power: Array = (run.wheel_torque_nm * run.wheel_speed_rad_s).sum(axis=1) * run.elapsed_s
    return power


def fit_surface_map(
    runs: Sequence[RunWindows],
    m_per_px: float,
    camera_drift_rad: float = 0.0,
    *,
    least_runs: int = SLIP_FIT.surface.least_runs,
) -> SurfaceMap:
    """Return the map of all surfaces in `runs`.

    Args:
        runs: On one surface each.
        m_per_px: Scale of the camera, for runs in pixels.
        camera_drift_rad: What the same camera sees of a rolling rover, to be taken off the drift it sees.
        least_runs: Runs that each surface must have.

    Raises:
        LogError: A surface has too few runs.
    """
    names = sorted({run.surface for run in runs})
    tables = [(run.surface, _table(run, m_per_px, camera_drift_rad)) for run in runs]
    surfaces = tuple(
        _fit_surface(name, [table for of, table in tables if of == name], least_runs) for name in names
    )
    directions = sorted({round(travel_direction_rad(run), 2) for run in runs})
    return SurfaceMap(surfaces=surfaces, directions_rad=tuple(directions))


def travel_direction_rad(run: RunWindows) -> float:
    """Return the direction of travel of a run in the body frame, by the encoders."""
    x_m, y_m = (run.encoder_velocity[:, :2] * run.elapsed_s[:, None]).sum(axis=0).tolist()
    return float(np.arctan2(y_m, x_m))


def steady_drift_rad(run: RunWindows) -> Array:
    """Return how far the camera sees the rover go to the left of the encoders' course, in steady windows."""
    return _drift_rad(run, _is_steady(run))


def _drift_rad(run: RunWindows, windows: Flags) -> Array:
    velocity, seen = run.encoder_velocity[windows], run.camera_velocity[windows]
    course = (velocity[:, 0] + 1j * velocity[:, 1]).conj()
    drift_rad: Array = np.angle((seen[:, 0] + 1j * seen[:, 1]) * course)
    return drift_rad


def _is_steady(run: RunWindows) -> Flags:
    """Return which windows are steady travel."""
    steady: Flags = (run.start_s >= SLIP_FIT.surface.start_s) & (
        run.encoder_distance_m() > SLIP_FIT.surface.least_speed_m_s * run.elapsed_s
    )
    return steady


def _fit_surface(name: str, tables: Sequence[Array], least_runs: int) -> SurfaceModel:
    if len(tables) < least_runs:
        raise LogError(
            f"surface '{name}' has {len(tables)} training runs, fewer than {least_runs}: "
            "give more, or leave it out"
        )
    run_of = np.concatenate([np.full(len(table), index) for index, table in enumerate(tables)])
    direction, speed, force_n, slip, drift_rad = np.concatenate(tables).T
    if len(direction) < SLIP_FIT.surface.least_windows * least_runs // SLIP_FIT.surface.least_runs:
        raise LogError(
            f"surface '{name}' has too little steady travel in its {len(tables)} runs: give longer ones"
        )
    tail = SLIP_FIT.surface.speed_tail
    low, high = np.quantile(speed, (tail, 1.0 - tail)).tolist()
    held = np.clip(speed, low, high)
    with_speed = high - low > SLIP_FIT.surface.least_speed_span_m_s
    equal = np.ones(len(slip))
    force_curve, force_residual_n = _fit_curve(direction, held, force_n, equal, with_speed)
    slip_curve, _ = _fit_curve(direction, held, slip, equal, with_speed)
    # The course of a rover that does not move is noise.
    moved = np.clip(1.0 - slip, 0.0, 1.0)
    drift_curve, _ = _fit_curve(direction, held, drift_rad, moved, with_speed)
    means = np.array([force_residual_n[run_of == index].mean() for index in np.unique(run_of)])
    return SurfaceModel(
        name=name,
        force_n=force_curve,
        slip=slip_curve,
        drift_rad=drift_curve,
        force_window_sd_n=max(float(force_residual_n.std()), SLIP_FIT.surface.least_window_sd_n),
        force_run_sd_n=max(float(means.std()), SLIP_FIT.surface.least_run_sd_n),
        speed_range_m_s=(low, high),
    )


def _table(run: RunWindows, m_per_px: float, camera_drift_rad: float) -> Array:
    """Return rows of direction, speed, force, slip and drift, for steady windows of known work."""
    steady = _is_steady(run) & run.work_known
    velocity, distance_m = run.encoder_velocity[steady], run.encoder_distance_m()[steady]
    drift_rad = _drift_rad(run, steady)
    if run.camera_in_pixels:
        drift_rad = np.angle(np.exp(1j * (drift_rad - camera_drift_rad)))
    rows: Array = np.column_stack(
        (
            np.arctan2(velocity[:, 1], velocity[:, 0]),
            distance_m / run.elapsed_s[steady],
            travel_work_j(run)[steady] / distance_m,
            1.0 - run.camera_distance_m(m_per_px)[steady] / distance_m,
            drift_rad,
        )
    )
    return rows


def _fit_curve(
    direction: Array, speed: Array, values: Array, weights: Array, with_speed: bool
) -> tuple[DirectionCurve, Array]:
    """Return the curve by ridge regression, and its residuals."""
    orders = np.arange(1, SLIP_FIT.surface.harmonics + 1)
    middle = float(speed.mean())
    angles = np.outer(direction, orders)
    columns = [np.ones(len(values)), *np.cos(angles).T, *np.sin(angles).T]
    penalties = [0.0, *orders, *orders]
    if with_speed:
        columns.append(speed - middle)
        penalties.append(0.0)
    matrix = np.column_stack(columns)
    weighted = matrix.T * weights
    normal = weighted @ matrix + SLIP_FIT.surface.ridge * np.diag(np.square(penalties))
    factors = np.linalg.solve(normal, weighted @ values)
    curve = DirectionCurve(
        mean=float(factors[0]),
        cosines=tuple(factors[1 : SLIP_FIT.surface.harmonics + 1].tolist()),
        sines=tuple(factors[SLIP_FIT.surface.harmonics + 1 : 2 * SLIP_FIT.surface.harmonics + 1].tolist()),
        speed_slope=float(factors[-1]) if with_speed else 0.0,
        speed_m_s=middle,
    )
    return curve, values - matrix @ factors
