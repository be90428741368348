"""Geometry of wheels, marker and gyro by `calibrate wheels` on the drives, and which number matters most."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.errors import LogError
from rover_hil.diagnose.replayed_drive import COPIED_DISTANCE, ReplayedDrive
from rover_hil.diagnose.trajectory_errors import Trajectory
from rover_hil.drives.toml_text import toml_text
from rover_hil.ready.procedure import Entry, Facts
from rover_hil.ready.wheels.drives_procedure import UNITS, DrivesCalibration, Recorded
from rover_hil.ready.wheels.from_drives import GeometryResult, geometry_from_drives
from rover_hil.ready.wheels.trajectory import RecordedDrive, recorded_of, wheel_trajectory
from rover_hil.ready.wheels.trajectory_fit import LEAST_DRIVES, Estimate, TrajectoryProblem

TO_PASTE = "to paste"


@dataclass(frozen=True, slots=True, kw_only=True)
class GeometryPart:
    """What `calibrate wheels` finds in the drives.

    Attributes:
        result: The numbers; None where they cannot be fitted.
        reason: Why there is no result; "" for one.
        facts: The facts of the calibration, for the user.
        numbers: The same for a program.
        entries: Where a configuration takes the numbers; empty where they are not accepted.
        harms: Share of the squared error by the wheels that each shown number explains, by name.
        marker: Numbers of the marker and the delay of the known places.
        wheels: Odometry of each drive, with numbers half-way between those that are better on validation
            drives and those that are fitted without it, else as described, and its times, by name.
    """

    result: GeometryResult | None = None
    reason: str = ""
    facts: Facts = ()
    numbers: Mapping[str, object] = field(default_factory=dict)
    entries: Sequence[Entry] = ()
    harms: Mapping[str, float] = field(default_factory=dict)
    marker: Mapping[str, float] = field(default_factory=dict)
    wheels: Mapping[str, tuple[np.ndarray, Trajectory]] = field(default_factory=dict)

    @property
    def is_accepted(self) -> bool:
        """Whether the numbers are better on validation drives, and one is outside of its interval."""
        return is_accepted(self.result)

    @property
    def is_shared(self) -> bool:
        """Whether the numbers are better on validation drives, of which none is outside of its interval."""
        return self.result is not None and self.result.is_shared

    @property
    def worst(self) -> Estimate | None:
        """The number of the wheels that does most harm; None where none is shown to differ.

        None as well where the numbers are plausible and no better in validation drives of every kind: of
        several numbers one is outside of its interval by chance.
        """
        if self.result is None:
            return None
        is_plausible = all(abs(each.value) <= each.number.plausible for each in self.result.shown)
        if is_plausible and self.result.errors and not self.is_accepted:
            return None
        return max(
            differing(self.result), key=lambda each: self.harms.get(each.number.name, 0.0), default=None
        )


def differing(result: GeometryResult) -> list[Estimate]:
    """Return the shown numbers of the wheels whose intervals do not contain the description."""
    return [each for each in result.shown if each.differs]


def is_accepted(result: GeometryResult | None) -> bool:
    """Return whether numbers are better on validation drives, and one differs beyond its interval."""
    return result is not None and not result.problem


def fit_geometry(drives: Sequence[ReplayedDrive]) -> GeometryPart:
    """Return what `calibrate wheels` finds in those drives that have known places."""
    with_truth = [each for each in drives if each.truth is not None]
    if not with_truth:
        if any(each.copied for each in drives):
            return GeometryPart(reason=f"the ground truth is left out, because {COPIED_DISTANCE}")
        return GeometryPart(reason="no drive has ground truth or positions")
    recorded: dict[str, RecordedDrive] = {}
    reasons = []
    for each in with_truth:
        try:
            recorded[each.name] = recorded_of(each.drive)
        except LogError as error:
            reasons.append(str(error))
    if not recorded:
        return GeometryPart(reason=reasons[0])
    fitted = list(recorded.values())
    result = geometry_from_drives(fitted)
    paths: list[Path] = [each.path for each in fitted]
    calibration = DrivesCalibration(fitted=paths, validation=())
    record = Recorded(fitted, ())
    accepted = is_accepted(result)
    return GeometryPart(
        result=result,
        facts=calibration.facts(record, result),
        numbers=calibration.json(record, result, None),
        entries=calibration.entries(record, result, None) if accepted else (),
        harms=_harms(result),
        marker={
            each.number.name: each.value
            for each in result.fit.estimates
            if each.is_shown and not each.number.is_geometry
        },
        wheels=_odometry(recorded, result),
    )


def _harms(result: GeometryResult) -> dict[str, float]:
    """Return how much of the squared error of the described wheels each shown number explains by itself."""
    fit = result.entered
    numbers = [each.number for each in fit.estimates]
    problem = TrajectoryProblem(result.drives, result.geometry, numbers)

    def left(values: Mapping[str, float]) -> float:
        return float(sum(np.sum(rest**2) for rest in problem.residuals(values, fit.sd)))

    values, best = fit.values, left(fit.values)
    shown = [each.number.name for each in result.shown]
    described = left({name: value for name, value in values.items() if name not in shown})
    gain = max(described - best, 1e-12)
    return {
        name: (left({key: value for key, value in values.items() if key != name}) - best) / gain
        for name in shown
    }


def _odometry(
    recorded: Mapping[str, RecordedDrive], result: GeometryResult
) -> dict[str, tuple[np.ndarray, Trajectory]]:
    numbers = [each.number for each in result.entered.estimates]
    found = {}
    fitted = result.entered.values if is_accepted(result) or result.is_shared else {}
    for (name, drive), without in zip(recorded.items(), result.entered.without, strict=True):
        problem = TrajectoryProblem([drive], result.geometry, numbers)
        # With a drive its errors are too small, without it too large. Few drives do not stand for each other.
        share = 0.5 if len(recorded) >= LEAST_DRIVES else 0.0
        values = {key: value + share * (without[key] - value) for key, value in fitted.items()}
        (moves,) = problem.moves(values)
        path = wheel_trajectory(moves)
        found[name] = (drive.t_s, Trajectory(path.place_m, path.yaw_rad))
    return found


def number_words(estimate: Estimate) -> str:
    """Return how far a number is from its description, with its interval."""
    factor, unit = UNITS[estimate.number.unit]
    value, half = factor * estimate.value, factor * estimate.half_width
    if unit == " %":
        more = "larger" if value > 0.0 else "smaller"
        least, most = sorted((abs(value) - half, abs(value) + half))
        return f"{abs(value):.2g} % {more} than described (95 %: {least:.2g} to {most:.2g} %)"
    return f"off by {value:+.2g}{unit} (95 %: {value - half:+.2g} to {value + half:+.2g}{unit})"


def settings_text(sections: Mapping[str, Mapping[str, object]]) -> str:
    """Return sections of a configuration as text to paste."""
    return toml_text(dict(sections)).strip()
