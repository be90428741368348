"""From measured runs to slip maps: training, cross-validation and test."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from controllers.slip.effort.motor_model import MotorSettings
from drivers.errors import LogError
from rover_hil.drives.marks import mark_files
from rover_hil.identify.slip.camera_scale import CameraScale, find_scale
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import RunWindows
from rover_hil.identify.slip.runs import read_windows, surface_parts
from rover_hil.identify.slip.scores import FittedMaps, RunError, score_runs
from rover_hil.identify.slip.surface_fit import fit_surface_map, travel_direction_rad
from rover_hil.identify.slip.wheel_fit import collect_samples, fit_wheel_maps
from rover_hil.parallel.calls import HERE, Calls

Advance = Callable[[], None]
"""Called after each piece of work, for a progress bar."""

Errors = dict[str, list[RunError]]
"""Errors of runs, by map."""


@dataclass(frozen=True, slots=True)
class SlipIdentification:
    """Fitted maps and their errors.

    Attributes:
        scale: The camera's.
        maps: Fitted to all of `trained_on`.
        trained_on: Runs on one surface each.
        left_out: Runs on several surfaces: the surface of a window is not known.
        cross_validation: Errors on runs that the fit had not seen, within `trained_on`.
        not_validated: How many of `trained_on` are missing there, as too little remains without them.
    """

    scale: CameraScale
    maps: FittedMaps
    trained_on: Sequence[RunWindows]
    left_out: Sequence[RunWindows]
    cross_validation: Errors
    not_validated: int


def read_all(
    files: Sequence[Path], motor: MotorSettings, advance: Advance, calls: Calls = HERE
) -> list[RunWindows]:
    """Return the runs in all files.

    Raises:
        LogError: A file cannot be used.
    """
    runs: list[RunWindows] = []
    for windows_of_file in calls.map_files(partial(read_windows, motor=motor), files, mark_files):
        runs += windows_of_file
        advance()
    return runs


def identify_slip_maps(
    runs: Sequence[RunWindows], advance: Advance, calls: Calls = HERE
) -> SlipIdentification:
    """Fit all maps and cross-validate them; `advance` is called once more than there are folds.

    Raises:
        ConfigError: scikit-learn is not installed.
        LogError: There is too little to fit.
    """
    names = sorted({run.surface for run in runs})
    several = {name for name in names if len(surface_parts(name, _single(names))) > 1}
    trained_on = [run for run in runs if run.surface not in several]
    scale = find_scale(trained_on)
    maps = fit_maps(trained_on, scale.m_per_px, scale.drift_rad or 0.0)
    advance()
    errors, not_validated = _cross_validate(trained_on, scale, advance, calls)
    return SlipIdentification(
        scale=scale,
        maps=maps,
        trained_on=trained_on,
        left_out=[run for run in runs if run.surface in several],
        cross_validation=errors,
        not_validated=not_validated,
    )


def fit_maps(
    runs: Sequence[RunWindows],
    m_per_px: float,
    camera_drift_rad: float = 0.0,
    *,
    least_runs: int = SLIP_FIT.surface.least_runs,
) -> FittedMaps:
    """Return all maps fitted to `runs`; scale and drift are those of the camera, for runs in pixels.

    Each surface must have `least_runs` of them.

    Raises:
        ConfigError: scikit-learn is not installed.
        LogError: There is too little to fit.
    """
    samples = collect_samples(runs, m_per_px)
    surfaces = fit_surface_map(runs, m_per_px, camera_drift_rad, least_runs=least_runs)
    return FittedMaps(fit_wheel_maps(samples), float(samples.slip.mean()), surfaces)


def _single(names: Sequence[str]) -> list[str]:
    """Return the names of one surface each: `green_surface`, but not `green_table` next to it."""
    return [name for name in names if len(surface_parts(name, [n for n in names if n != name])) == 1]


def _cross_validate(
    runs: Sequence[RunWindows], scale: CameraScale, advance: Advance, calls: Calls
) -> tuple[Errors, int]:
    """Leave out a fifth of the runs five times; every surface and all directions are in every fold.

    A surface with the fewest runs that are allowed has one less here. Returns the errors, and how many runs
    have none as the others are too few to fit.
    """
    ordered = sorted(runs, key=lambda run: (run.surface, travel_direction_rad(run), str(run.path)))
    errors: Errors = {}
    not_validated = 0
    folds = SLIP_FIT.validation.folds
    for fold, errors_of_fold in enumerate(calls.map(partial(_validate_fold, ordered, scale), range(folds))):
        if errors_of_fold is None:
            not_validated += len(ordered[fold::folds])
        for name, of_fold in (errors_of_fold or {}).items():
            errors.setdefault(name, []).extend(of_fold)
        advance()
    return errors, not_validated


def _validate_fold(ordered: Sequence[RunWindows], scale: CameraScale, fold: int) -> Errors | None:
    """Return the errors of the runs of a fold with maps of the others; None where these are too few."""
    folds = SLIP_FIT.validation.folds
    kept = [run for index, run in enumerate(ordered) if index % folds != fold]
    try:
        maps = fit_maps(
            kept, scale.m_per_px, scale.drift_rad or 0.0, least_runs=SLIP_FIT.surface.least_runs - 1
        )
    except LogError:
        return None
    return score_runs(maps, ordered[fold::folds], scale.m_per_px)
