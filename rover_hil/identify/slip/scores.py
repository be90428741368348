"""Errors of the distance by slip maps, run by run, as a fraction of the encoder distance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from controllers.slip.effort.slip_map import WheelMap, slip_at
from controllers.slip.effort.surface_map import NO_TRAVEL, SurfaceMap, SurfaceTracker, Travel
from controllers.slip.effort.travel_range import direction_problem
from rover_hil.drives.arrays import Array, rms
from rover_hil.identify.slip.run_data import WHEELS, RunWindows, to_wheels
from rover_hil.identify.slip.runs import surface_parts
from rover_hil.identify.slip.surface_fit import travel_direction_rad, travel_work_j

ENCODER = "encoder"
BEST = "best"
BEST_KNOWN = "best_known_surface"


@dataclass(frozen=True, slots=True)
class FittedMaps:
    """All maps fitted to one set of runs.

    Attributes:
        wheel_maps: By name.
        prior_slip: Mean slip of a wheel, for windows where its effort is not usable.
        surfaces: The map that recognises the surface.
    """

    wheel_maps: Mapping[str, WheelMap]
    prior_slip: float
    surfaces: SurfaceMap


@dataclass(frozen=True, slots=True)
class RunError:
    """Error of one map on one run.

    Attributes:
        surface: Name of the run's surface.
        direction_rad: Direction of travel.
        error: (estimated distance - camera distance) / encoder distance.
        invalid: Share of the encoder distance for which the map flags its own slip as not valid.
    """

    surface: str
    direction_rad: float
    error: float
    invalid: float


@dataclass(frozen=True, slots=True)
class Score:
    """Errors of a map over n runs; NaN over none."""

    rms: float
    bias: float
    n: int
    invalid: float

    @classmethod
    def of(cls, errors: Sequence[RunError]) -> "Score":
        """Summarise errors."""
        if not errors:
            return cls(float("nan"), float("nan"), 0, float("nan"))
        values = np.array([item.error for item in errors])
        invalid = float(np.mean([item.invalid for item in errors]))
        return cls(rms(values), float(values.mean()), len(errors), invalid)


def score_runs(maps: FittedMaps, runs: Sequence[RunWindows], m_per_px: float) -> dict[str, list[RunError]]:
    """Return the errors of every map on every run; the known-surface map skips unknown surfaces."""
    errors: dict[str, list[RunError]] = {name: [] for name in (ENCODER, *maps.wheel_maps, BEST, BEST_KNOWN)}
    known = [surface.name for surface in maps.surfaces.surfaces]
    for run in runs:
        encoder_m = float(run.encoder_distance_m().sum())
        if encoder_m <= 0.0:
            continue
        estimates: dict[str, tuple[float, float]] = {ENCODER: (encoder_m, 0.0)}
        for name, wheel_map in maps.wheel_maps.items():
            estimates[name] = _predict_by_wheels(run, wheel_map, maps)
        estimates[BEST] = predict_by_surface(run, maps.surfaces)
        parts = surface_parts(run.surface, known)
        if set(parts) <= set(known):
            estimates[BEST_KNOWN] = predict_by_surface(run, maps.surfaces.only(parts))
        camera_m = float(run.camera_distance_m(m_per_px).sum())
        for name, (distance_m, invalid) in estimates.items():
            error = (distance_m - camera_m) / encoder_m
            errors[name].append(RunError(run.surface, travel_direction_rad(run), error, invalid))
    return errors


def predict_by_surface(run: RunWindows, surfaces: SurfaceMap) -> tuple[float, float]:
    """Return the distance and invalid share of a run by the map of surfaces."""
    tracker = SurfaceTracker(surfaces, run.rover.base_radius_m)
    steps = np.column_stack(
        (run.elapsed_s, run.encoder_velocity * run.elapsed_s[:, None], travel_work_j(run))
    )
    distance_m = invalid_m = 0.0
    windows = zip(steps.tolist(), run.encoder_distance_m().tolist(), run.work_known.tolist(), strict=True)
    for step, encoder_m, is_known in windows:
        if not is_known:
            tracker.interrupt()
        estimate = tracker.step(Travel(*step) if is_known else NO_TRAVEL)
        distance_m += encoder_m * (1.0 - estimate.slip)
        invalid_m += 0.0 if estimate.valid and is_known else encoder_m
    return distance_m, invalid_m / float(run.encoder_distance_m().sum())


def _predict_by_wheels(run: RunWindows, wheel_map: WheelMap, maps: FittedMaps) -> tuple[float, float]:
    forward = np.sign(run.wheel_speed_rad_s)
    values: Array = forward * getattr(run, wheel_map.feature)
    slips = np.array([slip_at(wheel_map, value) for value in values.ravel().tolist()]).reshape(-1, WHEELS)
    slips = np.where(run.usable, slips, maps.prior_slip)
    to_body = np.linalg.inv(to_wheels(run.rover))
    velocity = (run.wheel_speed_rad_s * (1.0 - slips)) @ to_body.T
    distance_m = float((np.hypot(velocity[:, 0], velocity[:, 1]) * run.elapsed_s).sum())
    outside = (values < wheel_map.valid_from) | (values > wheel_map.valid_to) | ~run.usable
    directions = np.arctan2(run.encoder_velocity[:, 1], run.encoder_velocity[:, 0]).tolist()
    known = maps.surfaces.directions_rad
    outside |= np.array([bool(direction_problem(known, direction)) for direction in directions])[:, None]
    weights = np.abs(run.wheel_speed_rad_s) * run.elapsed_s[:, None]
    return distance_m, float((outside * weights).sum() / weights.sum())
