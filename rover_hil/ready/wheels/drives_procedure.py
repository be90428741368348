"""`rover-hil calibrate wheels CONFIG_OR_DRIVE LOGS`: geometry from recorded drives with ground truth."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from controllers.motion.rover_geometry import OmniRoverSettings, RoverSettings, WheelsRoverSettings
from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.config.entry import EntryValue
from rover_hil.console.options import log_at
from rover_hil.drives.presets import presets
from rover_hil.drives.quality.drive_paths import GROUND_TRUTH
from rover_hil.drives.toml_text import toml_text
from rover_hil.pages.picture import Drawing
from rover_hil.ready.procedure import Entry, Facts, FileProcedure, Request, comments
from rover_hil.ready.wheels.drive_figures import draw_errors, draw_kinds, draw_path
from rover_hil.ready.wheels.from_drives import GeometryResult, KindDifference, geometry_from_drives
from rover_hil.ready.wheels.geometry import MARKER, MARKER_X, MARKER_Y, MARKER_YAW
from rover_hil.ready.wheels.motion_kinds import BY_HAND, KINDS
from rover_hil.ready.wheels.trajectory import RecordedDrive, read_recorded
from rover_hil.ready.wheels.trajectory_fit import Estimate
from rover_hil.ready.wheels.validation import KindErrors

UNITS = {"": (100.0, " %"), "m": (1.0, " m"), "deg": (math.degrees(1.0), " deg"), "s": (1.0, " s")}
"""What a number is multiplied by for the user, and its unit there."""
DECIMALS = 6
CHANGED = ("x_m", "y_m", "radius_m", "angle_deg")
"""Values of a wheel that are calibrated."""


class Recorded(NamedTuple):
    """The drives: those that are fitted, and those that only validate."""

    drives: Sequence[RecordedDrive]
    validation: Sequence[RecordedDrive]


@dataclass
class DrivesCalibration(FileProcedure[Recorded, GeometryResult]):
    """Geometry of the wheels, marker and gyro from drives with ground truth or positions.

    Attributes:
        fitted: Logs of the drives, or folders of runs.
        validation: The same of drives that only validate.
    """

    takes_log = False
    page_word = "page"

    fitted: Sequence[Path]
    validation: Sequence[Path]

    def __post_init__(self) -> None:
        self.logs = [log_at(path) for path in (*self.fitted, *self.validation)]
        self._config: Config | None = None
        self._is_log = self._enters = False

    def configure(self, request: Request, config: Config | None) -> Path | None:
        if request.enter and request.source in presets():
            raise ConfigError(f"--enter: {request.source} cannot be edited: name a TOML file of yours")
        self._config, self._enters = config, request.enter
        self._is_log = log_at(Path(request.source)) in self.logs
        return request.out

    def read(self, logs: Sequence[Path]) -> Recorded:
        """Return the drives.

        Raises:
            ConfigError: The configuration is of a rover with other wheels.
            LogError: A drive has no ground truth, or not every wheel is measured.
        """
        drives = [read_recorded(path) for path in logs]
        if self._config is not None and not self._is_log:
            described, recorded = self._config.rover, drives[0].rover
            if type(described) is not type(recorded) or _wheels(described) != _wheels(recorded):
                raise ConfigError(
                    f"{drives[0].path} is of a rover with other wheels than [rover] of the configuration: "
                    "name the configuration of that rover, or the logs alone"
                )
        return Recorded(drives[: len(self.fitted)], drives[len(self.fitted) :])

    def fit(self, record: Recorded) -> GeometryResult:
        rover = None if self._config is None or self._is_log else self._config.rover
        return geometry_from_drives(record.drives, record.validation, rover)

    def title(self, record: Recorded, result: GeometryResult) -> str:
        return f"Wheels: {'not calibrated, ' if result.problem else ''}{answer(result)}"

    def facts(self, record: Recorded, result: GeometryResult) -> Facts:
        facts = [("answer", answer(result))]
        facts += [
            (each.number.name, f"{estimate_words(each)}{_mark(each, result)}")
            for each in result.fit.estimates
            if each.is_shown and each not in result.not_shown
        ]
        facts += [(f"validation, {each.kind}", _error_words(each)) for each in result.by_kind]
        facts += [(f"{each.number.name} by motion", _difference_words(each)) for each in result.differences]
        facts += [
            (
                f"{each.number.name} not shown",
                f"{estimate_words(each)}{_mark(each, result)}; would show it: {each.number.shown_by}"
                if each.is_shown
                else f"stays as described; would show it: {each.number.shown_by}",
            )
            for each in result.not_shown
        ]
        driven = {*result.kinds, *(each.kind for each in result.by_kind)}
        others = [kind for kind in KINDS if kind not in driven and kind != BY_HAND]
        if others and result.shown:
            facts.append(("not driven", f"{', '.join(others)}: whether the numbers hold there is not shown"))
        if result.gyro is not None:
            facts.append(("gyro scale", _gyro_words(result)))
        if not result.problem:
            facts.append(("to enter", "; ".join(_changes(result))))
            facts.append(("to paste", toml_text(_sections(result)).strip()))
        return facts

    def json(self, record: Recorded, result: GeometryResult, out: Path | None) -> Mapping[str, object]:
        return {
            "answer": answer(result),
            "problem": result.problem,
            "rover": _rover_section(result.corrected),
            "numbers": {
                each.number.name: {
                    "value": each.value,
                    "half_width": each.half_width if math.isfinite(each.half_width) else None,
                    "is_shown": each.is_shown,
                    "is_entered": not result.problem and each.number.name in result.entered.values,
                }
                for each in result.fit.estimates
            },
            "validation": {
                each.kind: {
                    "drives": each.drives,
                    "end_m": each.end_m,
                    "end_rad": [None if math.isnan(value) else value for value in each.end_rad],
                }
                for each in result.by_kind
            },
            "differences": [
                {"number": each.number.name, "by_kind": each.values, "points_to": each.points_to}
                for each in result.differences
            ],
            "gyro": None
            if result.gyro is None
            else {
                "scale": result.gyro.scale,
                "half_width": result.gyro.half_width,
                "bias_rad_s": result.gyro.bias_rad_s.tolist(),
            },
        }

    def figures(self, record: Recorded, result: GeometryResult) -> Sequence[Drawing]:
        return (
            Drawing(
                "Error at the end of the validation drives",
                "See whether the blue dots are lower than the orange ones in every kind of motion.",
                lambda: draw_errors(result),
            ),
            Drawing(
                "Numbers by kind of motion",
                "See whether the intervals of a number overlap. Where they do not, no single value is right.",
                lambda: draw_kinds(result.differences),
            ),
            Drawing(
                "The validation drive with the greatest error",
                "See whether the blue path stays with the black one to its end.",
                lambda: draw_path(result),
            ),
        )

    def write(self, record: Recorded, result: GeometryResult) -> str:
        facts = [(name, value) for name, value in self.facts(record, result) if name != "to paste"]
        return comments(facts) + toml_text(_sections(result))

    def entries(self, record: Recorded, result: GeometryResult, out: Path | None) -> Sequence[Entry]:
        section, described = _rover_section(result.corrected), result.geometry.rover
        entries = [Entry("rover", key, value) for key, value in section.items()]
        if "wheels" in section and isinstance(described, OmniRoverSettings):
            if self._enters and self._config is not None and self._config.slip is not None:
                raise ConfigError(
                    "--enter: the radii of the wheels differ, which needs kinematics = 'wheels', but [slip] "
                    "needs 'omni3': leave --enter out, and copy the values or remove [slip]"
                )
            entries += [Entry("rover", key, None) for key in described.model_dump() if key not in section]
        return entries


def answer(result: GeometryResult) -> str:
    """Return what came out, in one sentence."""
    if result.problem:
        return result.problem
    errors = [f"{each.kind} {each.end_m[0]:.3g} -> {each.end_m[1]:.3g} m" for each in result.by_kind]
    return f"the corrected wheels are better; error at the end of validation drives: {', '.join(errors)}"


def _wheels(rover: RoverSettings) -> int:
    return len(rover.wheels) if isinstance(rover, WheelsRoverSettings) else 0


def estimate_words(estimate: Estimate) -> str:
    """Return by how much a number differs from its description, with its interval."""
    factor, unit = UNITS[estimate.number.unit]
    return f"{factor * estimate.value:+.3g} +- {factor * estimate.half_width:.2g}{unit} (95 %)"


def _mark(estimate: Estimate, result: GeometryResult) -> str:
    """Return what becomes of a number that does not differ from its description; "" for one that does."""
    if estimate.differs or not (estimate.number.is_geometry or estimate.number.name in MARKER):
        return ""
    if result.problem or estimate.number.name not in result.entered.values:
        return "; not shown to differ, stays as described"
    return "; not shown to differ by itself, entered because validation drives are worse without it"


def _changes(result: GeometryResult) -> list[str]:
    """Return each value of [rover] that changes, before and after."""
    rover = result.corrected
    if not isinstance(rover, WheelsRoverSettings):
        before, after = _rover_section(result.geometry.rover), _rover_section(rover)
        return [f"{key} {before[key]} -> {value}" for key, value in after.items() if value != before[key]]
    changes: dict[str, list[str]] = {}
    for place, (old, new) in enumerate(zip(result.geometry.wheels, rover.wheels, strict=True)):
        for key in CHANGED:
            values = [round(getattr(wheel, key), DECIMALS) for wheel in (old, new)]
            if values[0] != values[1]:
                changes.setdefault(f"{key} {values[0]:g} -> {values[1]:g}", []).append(str(place))
    return [
        f"{change} of wheel{'s' if len(places) > 1 else ''} {', '.join(places)}"
        for change, places in changes.items()
    ]


def _error_words(errors: KindErrors) -> str:
    drives = f"{errors.drives} drive{'' if errors.drives == 1 else 's'}"
    place = f"at the end {errors.end_m[0]:.3g} -> {errors.end_m[1]:.3g} m"
    if math.isnan(errors.end_rad[0]):
        return f"{drives}, {place}"
    before_deg, after_deg = map(math.degrees, errors.end_rad)
    return f"{drives}, {place}, {before_deg:.3g} -> {after_deg:.3g} deg"


def _difference_words(difference: KindDifference) -> str:
    factor, unit = UNITS[difference.number.unit]
    values = [
        f"{kind} {factor * value:+.3g} +- {factor * half:.2g}{unit}"
        for kind, (value, half) in difference.values.items()
    ]
    return f"{', '.join(values)}: {difference.points_to}"


def _gyro_words(result: GeometryResult) -> str:
    gyro = result.gyro
    assert gyro is not None  # noqa: S101 the caller has checked it
    if not gyro.is_shown:
        return "not shown: drive rotations to both sides, with pauses"
    low, high = (math.degrees(bias) for bias in (gyro.bias_rad_s.min(), gyro.bias_rad_s.max()))
    bias = f"{low:+.3f}" if high - low < 5e-4 else f"{low:+.3f} to {high:+.3f}"
    return f"{gyro.scale:.4f} +- {gyro.half_width:.4f} of the {gyro.reference}, bias {bias} deg/s"


def _rover_section(rover: RoverSettings) -> dict[str, EntryValue]:
    """Return the keys of [rover] that are calibrated."""
    if isinstance(rover, WheelsRoverSettings):
        wheels = [each.model_dump(exclude_defaults=True, mode="json") for each in rover.wheels]
        return {"kinematics": "wheels", "wheels": [_rounded(wheel) for wheel in wheels]}
    if isinstance(rover, OmniRoverSettings):
        base = "base_radius_m", rover.base_radius_m
    else:
        base = "track_m", rover.track_m
    return {"wheel_radius_m": round(rover.wheel_radius_m, DECIMALS), base[0]: round(base[1], DECIMALS)}


def _rounded(wheel: Mapping[str, object]) -> dict[str, object]:
    return {
        key: round(value, DECIMALS) if isinstance(value, float) else value for key, value in wheel.items()
    }


def _sections(result: GeometryResult) -> dict[str, object]:
    """Return what is calibrated, as sections of a configuration and of a file of columns."""
    values, first = result.entered.values, result.drives[0]
    arm_m = first.truth.arm_m
    marker = {
        key: round(factor * values[name] + before, DECIMALS)
        for key, name, factor, before in (
            ("x_m", MARKER_X, 1.0, arm_m.real),
            ("y_m", MARKER_Y, 1.0, arm_m.imag),
            ("yaw_deg", MARKER_YAW, math.degrees(1.0), 0.0),
        )
        if name in values
    }
    sections: dict[str, object] = {"rover": _rover_section(result.corrected)}
    if marker:
        sections["truth" if first.source == GROUND_TRUTH else "fixes"] = {"marker": marker}
    return sections
