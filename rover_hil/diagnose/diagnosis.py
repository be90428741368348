"""All that drives show: errors, geometry, covariance, sensors, and the answer in three sentences."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drivers.samples import Sample
from rover_hil.config import Config
from rover_hil.diagnose.covariance import (
    Normalised,
    Settings,
    by_kind,
    judged,
    learned_settings,
    normalised_errors,
)
from rover_hil.diagnose.drive_errors import (
    ESTIMATE,
    ODOMETRY,
    Compared,
    Errors,
    compare,
    errors_of,
    leg_m,
    travel_shares,
)
from rover_hil.diagnose.gap_answer import gap_answer
from rover_hil.diagnose.geometry import GeometryPart, fit_geometry, number_words
from rover_hil.diagnose.intervals import Interval, mean_of, short
from rover_hil.diagnose.recorded import (
    COPIED_DISTANCE,
    OTHER_KINDS,
    Measurements,
    NotShown,
    measurements_of,
    not_shown,
)
from rover_hil.diagnose.replayed_drive import ReplayedDrive, replay_drive, replay_of
from rover_hil.diagnose.trajectory_errors import Trajectory, absolute_errors
from rover_hil.drives.arrays import Array, rms
from rover_hil.drives.quality.consistency import Consistency
from rover_hil.ready.wheels.drives_procedure import UNITS
from rover_hil.ready.wheels.geometry import BASES
from rover_hil.recording.findings import FoundFinding

HELD_OUT_EVERY = 3
LEAST_SCALE = 0.002
"""A smaller error of the scale of a gyro turns the estimate by less than a degree per rotation."""
LEAST_SLIP = 0.02
"""A smaller share of the travel is that of a hard floor, see [ground] slip = "firm"."""
MOST_LEFT_OUT = 2
"""More drives are not replayed again without each sensor."""
BETTER_WITHOUT = 0.7
"""The estimate is better without a sensor where its error is smaller than this share of that with it."""
MOST_VALIDATED = 3
"""More drives are not replayed again with other settings."""
Report = Callable[[str, Path, int], None]
"""Gets what is being done, the log, and how many bytes of it are read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The diagnosis in three sentences.

    Attributes:
        worth: What the odometry is worth.
        cause: The most harmful cause.
        next_step: What to do next.
    """

    worth: str
    cause: str
    next_step: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """What drives show.

    Attributes:
        drives: The drives.
        compared: Their tracks at the known places, by name.
        errors: Of odometry and estimate; None without known places.
        geometry: Of the wheels.
        normalised: Errors of the estimate over its covariance, of the drives where that is known.
        settings: That would be right; None where the covariance is not judged.
        measurements: What became of them, by device.
        without: ATE without a device and with it, m, by its name, of the `MOST_LEFT_OUT` longest drives;
            empty where it was not asked for.
        slip: Share of the wheels' travel that was lost, by kind of motion; where the ground truth has a yaw.
        gap: Answer of `gap rover`, or why it was not asked.
        not_shown: What the drives cannot show.
    """

    drives: Sequence[ReplayedDrive]
    compared: Mapping[str, Compared]
    errors: Errors | None
    geometry: GeometryPart
    normalised: Sequence[Normalised]
    settings: Settings | None
    measurements: Sequence[Measurements]
    without: Mapping[str, tuple[float, float]]
    slip: Mapping[str, Interval]
    gap: str
    not_shown: Sequence[NotShown]

    @property
    def covariance(self) -> Consistency | None:
        """Whether the covariance holds; None where nothing shows it."""
        return judged(self.normalised) if self.normalised else None

    @property
    def why_no_errors(self) -> str:
        """Why the errors are not known, where they are not."""
        if any(each.copied for each in self.drives):
            return COPIED_DISTANCE
        return "there is neither ground truth nor positions"

    @property
    def answer(self) -> Answer:
        """The three sentences."""
        return Answer(worth=_worth(self), cause=_cause(self), next_step=_next_step(self))

    @property
    def causes(self) -> list[tuple[FoundFinding, list[str]]]:
        """Findings of whole drives, each once, and the drives that have it; the most frequent first."""
        found: dict[str, tuple[FoundFinding, list[str]]] = {}
        for each in self.drives:
            for finding in _of_whole_drives(each):
                found.setdefault(finding.name, (finding, []))[1].append(each.name)
        return sorted(found.values(), key=lambda item: -len(item[1]))


def diagnose(paths: Sequence[Path], report: Report, *, is_quick: bool) -> Diagnosis:
    """Return what the drives in logs show.

    Args:
        paths: The logs, of one rover.
        report: Gets the progress.
        is_quick: Do not replay the longest drives without each sensor, and do not ask `gap rover`.

    Raises:
        LogError: A log cannot be read or is damaged, or the logs are of different rovers.
    """
    drives = [_replayed(path, report) for path in paths]
    geometry = fit_geometry(drives)
    compared = _all_compared(drives, geometry)
    normalised = [
        found
        for each in drives
        if each.name in compared
        and (found := normalised_errors(each, each.replay, compared[each.name])) is not None
    ]
    corrected = _with_wheels(compared, geometry)
    return Diagnosis(
        drives=drives,
        compared=compared,
        errors=errors_of(compared),
        geometry=geometry,
        normalised=normalised,
        settings=_settings(drives, corrected, normalised, geometry, report),
        measurements=measurements_of(drives),
        without={} if is_quick else _without_each(drives, compared, geometry, report),
        slip=_slip(drives, corrected),
        gap="not asked: --quick" if is_quick else _gap(drives, compared, geometry, report),
        not_shown=not_shown(drives, geometry),
    )


def _of_whole_drives(each: ReplayedDrive) -> list[FoundFinding]:
    return [finding for finding in each.findings if finding.t_s is None]


def _replayed(path: Path, report: Report) -> ReplayedDrive:
    return replay_drive(path, lambda done: report(f"replaying {path.name}", path, done))


def _marker(each: ReplayedDrive, geometry: GeometryPart) -> Mapping[str, float]:
    """Return where the known places are: the pose of a simulated rover is that of its origin."""
    return {} if each.drive.log.origin == "virtual" else geometry.marker


def _all_compared(drives: Sequence[ReplayedDrive], geometry: GeometryPart) -> dict[str, Compared]:
    return {
        each.name: found
        for each in drives
        if (found := compare(each, each.replay, _marker(each, geometry))) is not None
    }


def _with_wheels(compared: Mapping[str, Compared], geometry: GeometryPart) -> dict[str, Compared]:
    """Return the drives with their odometry by the corrected wheels, where these are accepted."""
    if not geometry.is_accepted:
        return dict(compared)
    changed = {}
    for name, each in compared.items():
        if name not in geometry.wheels or each.true.yaw_rad is None:
            continue
        t_s, path = geometry.wheels[name]
        assert path.yaw_rad is not None  # noqa: S101 wheels have one
        at = Trajectory(np.interp(each.t_s, t_s, path.place_m), np.interp(each.t_s, t_s, path.yaw_rad))
        changed[name] = replace(each, tracks={**each.tracks, ODOMETRY: at})
    return changed


def _settings(
    drives: Sequence[ReplayedDrive],
    compared: Mapping[str, Compared],
    normalised: Sequence[Normalised],
    geometry: GeometryPart,
    report: Report,
) -> Settings | None:
    """Return the settings that would be right, tried on drives that they are not from.

    None where the covariance is not judged, or a finding has to be corrected first: one that slip in
    rotations does not explain.
    """
    differences = () if geometry.result is None else geometry.result.differences
    slips = any(each.number.name in BASES for each in differences)
    if not normalised or (not slips and any(_of_whole_drives(each) for each in drives)):
        return None
    judged_drives = [each for each in drives if any(each.name == other.drive for other in normalised)]
    every = min(HELD_OUT_EVERY, len(judged_drives))
    held = [each for place, each in enumerate(judged_drives, start=1) if place % every == 0]
    held = held[:MOST_VALIDATED] if len(judged_drives) > 1 else []

    def validate(settings: Settings) -> tuple[Sequence[Normalised], Sequence[Normalised]]:
        before, after = [], []
        for each in held:
            path = each.drive.log.path
            again = replay_of(
                path,
                lambda done, path=path: report(f"replaying {path.name} with other settings", path, done),  # type: ignore[misc]
                lambda config: settings.applied(_corrected(config, geometry)),
            )
            marker = _marker(each, geometry)
            now = compare(each, again, marker)
            found = None if now is None else normalised_errors(each, again, now)
            if found is not None:
                after.append(found)
                before += [other for other in normalised if other.drive == each.name]
        return before, after

    return learned_settings(compared, drives[0].drive.config, validate, [each.name for each in held])


def _corrected(config: Config, geometry: GeometryPart) -> Config:
    result = geometry.result
    if result is None or not geometry.is_accepted:
        return config
    if config.slip is not None and type(result.corrected) is not type(config.rover):
        return config  # the slip needs wheels of one radius
    return config.model_copy(update={"rover": result.corrected})


def _without_each(
    drives: Sequence[ReplayedDrive],
    compared: Mapping[str, Compared],
    geometry: GeometryPart,
    report: Report,
) -> dict[str, tuple[float, float]]:
    """Return the ATE without each device in turn, and with it; wheels are always used."""
    longest = sorted((each for each in drives if each.name in compared), key=lambda each: -each.distance_m)[
        :MOST_LEFT_OUT
    ]
    whole = [_ate_errors(compared[each.name]) for each in longest]
    roles = drives[0].drive.config.roles
    others = (roles.gyro, *roles.headings, *drives[0].drive.config.fix_sources, roles.camera)
    devices = list(dict.fromkeys(device for device in others if device not in (None, roles.wheels)))
    found = {}
    for device in devices:
        errors = []

        def is_used(sample: Sample, device: str | None = device) -> bool:
            return sample.device != device

        for each in longest:
            path = each.drive.log.path
            again = replay_of(
                path,
                lambda done, path=path, device=device: report(  # type: ignore[misc]
                    f"replaying {path.name} without {device}", path, done
                ),
                is_used=is_used,
            )
            now = compare(each, again, _marker(each, geometry))
            if now is not None:
                errors.append(_ate_errors(now))
        if errors:
            found[str(device)] = (rms(np.concatenate(errors)), rms(np.concatenate(whole)))
    return found


def _ate_errors(compared: Compared) -> Array:
    return absolute_errors(compared.tracks[ESTIMATE].place_m, compared.true.place_m)


def _slip(drives: Sequence[ReplayedDrive], compared: Mapping[str, Compared]) -> dict[str, Interval]:
    """Return the share of the wheels' travel that was lost, by kind of motion."""
    found, size_m = {}, leg_m(compared.values())
    for kind in dict.fromkeys(each.kind for each in drives):
        shares = [
            (1.0 - travel_shares(compared[each.name], size_m).real).tolist()
            for each in drives
            if each.kind == kind and each.name in compared
        ]
        slip = mean_of(shares)
        if slip.count:
            found[kind] = slip
    return found


def _gap(
    drives: Sequence[ReplayedDrive],
    compared: Mapping[str, Compared],
    geometry: GeometryPart,
    report: Report,
) -> str:
    """Return the answer of `gap rover`; a fault of a sensor would be taken for one of the model."""
    if any(_of_whole_drives(each) for each in drives):
        return "not asked before the findings are corrected"
    longest = sorted((each for each in drives if each.name in compared), key=lambda each: -each.distance_m)
    config = _corrected(drives[0].drive.config, geometry)
    answer = gap_answer(
        [each.drive.log.path for each in longest],
        config,
        lambda step: report(f"gap rover: {step}", Path(), 0),
    )
    return answer if config is drives[0].drive.config else f"with the corrected wheels, {answer}"


def _worth(diagnosis: Diagnosis) -> str:
    """Return what the odometry is worth, in one sentence."""
    drives, errors = diagnosis.drives, diagnosis.errors
    count = f"{len(drives)} drive{'' if len(drives) == 1 else 's'}"
    driven = (
        f"{count}, {sum(each.distance_m for each in drives):.3g} m and "
        f"{sum(each.rotations for each in drives):.3g} rotations by the wheels"
    )
    if errors is None:
        return f"In {driven}, what the odometry is worth cannot be known: {diagnosis.why_no_errors}."
    per = "per 100 m" if errors.per_rotation_rad[ODOMETRY].count else "of length per 100 m"
    distance, turn = errors.per_100_m[ODOMETRY], errors.per_rotation_rad[ODOMETRY]
    has_yaw = any(each.truth is not None and each.truth.yaw_rad is not None for each in drives)
    why = "the drives rotate too little" if has_yaw else "no known place has a yaw of its own"
    rotation = f"the error per rotation is not known, because {why}"
    if turn.count:
        rotation = f"turns {_degrees(turn).words('deg')} too far per rotation"
        if turn.value < 0.0:
            rotation = f"turns {_degrees(turn, -1.0).words('deg')} too little per rotation"
    estimate = errors.per_100_m[ESTIMATE]
    used = "" if all(each.is_independent for each in drives) else ", by positions that it has used"
    return (
        f"In {driven}, the odometry is off by {distance.words('m')} {per}, measured over parts of "
        f"{errors.part_m:g} m, and {rotation}; the estimate is off by {estimate.words('m')} per 100 m{used}."
    )


def _degrees(interval: Interval, sign: float = 1.0) -> Interval:
    return interval.times(sign * math.degrees(1.0))


def _cause(diagnosis: Diagnosis) -> str:
    """Return the most harmful cause, in one sentence."""
    if diagnosis.causes:
        finding, names = diagnosis.causes[0]
        return f"Most harmful in {len(names)} of {len(diagnosis.drives)} drives: {finding.text}."
    geometry, slip = _of_geometry(diagnosis.geometry), _of_slip(diagnosis.slip)
    result = diagnosis.geometry.result
    has_geometry = diagnosis.geometry.is_accepted or (result is not None and bool(result.differences))
    # A number that is not accepted may be slip.
    found = geometry if has_geometry else slip or geometry
    found = found or slip or _of_rotation(diagnosis.errors)
    of_sensors = "; ".join([*_of_gyro(diagnosis.geometry), *_of_harmful(diagnosis.without)])
    if of_sensors:
        return f"{found}; {of_sensors}." if found else f"Most harmful: {of_sensors}."
    return f"{found or _of_estimate(diagnosis)}."


def _of_geometry(geometry: GeometryPart) -> str:
    """Return which number of the description does most harm; "" where none is shown to differ."""
    result = geometry.result
    if result is None:
        return ""
    if result.differences:
        first = result.differences[0]
        factor, unit = UNITS[first.number.unit]
        values = ", ".join(f"{kind} {factor * value:+.2g}{unit}" for kind, (value, _) in first.values.items())
        return (
            f"Most harmful: no single {first.number.name} fits all kinds of motion ({values} from the "
            f"description), which points to {first.points_to}"
        )
    worst = geometry.worst
    if worst is not None:
        share = 100.0 * min(geometry.harms.get(worst.number.name, 0.0), 1.0)
        return (
            f"Most harmful: the {worst.number.name} is {number_words(worst)}, which explains {share:.0f} % "
            "of the squared error that the numbers of the wheels explain"
        )
    return ""


def _of_gyro(geometry: GeometryPart) -> Iterator[str]:
    """Yield that the scale of the gyro is wrong, where it is."""
    gyro = None if geometry.result is None else geometry.result.gyro
    if gyro is not None and gyro.is_shown and abs(gyro.scale - 1.0) > max(gyro.half_width, LEAST_SCALE):
        low, high = gyro.scale - gyro.half_width, gyro.scale + gyro.half_width
        yield f"the gyro measures {gyro.scale:.5g} of the rotation (95 %: {low:.5g} to {high:.5g})"


def _of_harmful(without: Mapping[str, tuple[float, float]]) -> Iterator[str]:
    """Yield which sensor makes the estimate worse."""
    for device, (ate_m, whole_m) in without.items():
        if ate_m < BETTER_WITHOUT * whole_m:
            change = f"ATE {short(ate_m)} m instead of {short(whole_m)} m"
            yield f"the estimate is better without {device}: {change}"


def _of_slip(slips: Mapping[str, Interval]) -> str:
    """Return in which kind of motion the wheels lose most travel; "" where they lose none beyond chance."""
    shown = {
        kind: slip
        for kind, slip in slips.items()
        if slip.is_known and abs(slip.value) >= LEAST_SLIP and not slip.low <= 0.0 <= slip.high
    }
    if not shown:
        return ""
    kind = max(shown, key=lambda each: abs(shown[each].value))
    lost = shown[kind].times(100.0).words("%")
    is_alike = max(each.low for each in slips.values()) <= min(each.high for each in slips.values())
    radius = ", or their radius is smaller by as much: these drives do not show which" if is_alike else ""
    return f"Most harmful: the wheels lose {lost} of their travel in motion of the kind '{kind}'{radius}"


def _of_rotation(errors: Errors | None) -> str:
    """Return that the rotations by the wheels are wrong beyond chance; "" where they are not."""
    turn = None if errors is None else errors.per_rotation_rad[ODOMETRY]
    if turn is None or not turn.is_known or turn.low <= 0.0 <= turn.high:
        return ""
    what = "too far" if turn.value > 0.0 else "too little"
    return (
        f"Most harmful: the wheels turn {what} in rotations, by the track, the base or slip; these drives do "
        "not show which"
    )


def _of_estimate(diagnosis: Diagnosis) -> str:
    """Return what is wrong with the estimate, where nothing is wrong with what was measured."""
    for each in diagnosis.measurements:
        if each.faults:
            return f"Most harmful: {next(iter(each.faults.values()))}"
    covariance = diagnosis.covariance
    if covariance is not None and (covariance.is_too_small or covariance.is_too_large):
        return f"No error of wheels or sensors is shown; standard deviation: {covariance.words('poses')}"
    for kind, found in by_kind(diagnosis.normalised).items():
        if found.is_too_small:
            words = found.words("poses")
            return f"No error of wheels or sensors is shown; standard deviation, {kind}: {words}"
    rules = [finding for each in diagnosis.drives for finding in each.findings]
    if rules:
        return f"Most harmful: {rules[0].text}"
    if diagnosis.errors is None:
        return "No sensor contradicts another; errors that all of them share cannot be known"
    return "No error of wheels, sensors or standard deviation is shown"


def _next_step(diagnosis: Diagnosis) -> str:
    """Return what to do next, in one sentence."""
    if diagnosis.causes:
        return "Correct this first, as the finding states, and diagnose again: all other numbers rest on it."
    if diagnosis.geometry.is_accepted:
        others = next((each.shown_by for each in diagnosis.not_shown if each.what == OTHER_KINDS), "")
        more = f", and record {others}, which would show whether they hold there" if others else ""
        return f"Enter the corrected numbers (--config FILE --enter, or paste them){more}."
    settings = diagnosis.settings
    if settings is not None and settings.is_accepted:
        return "Enter the settings of the ground and the filter (--config FILE --enter, or paste them)."
    if any(_of_gyro(diagnosis.geometry)):
        return "Calibrate the gyro with `rover-hil calibrate mounting`, and diagnose new drives."
    harmful = next(
        (
            device
            for device, (ate_m, whole_m) in diagnosis.without.items()
            if ate_m < BETTER_WITHOUT * whole_m
        ),
        "",
    )
    if harmful:
        return (
            f"Check noise, delay and mounting of {harmful} in the configuration, or leave it out of [roles]."
        )
    result = diagnosis.geometry.result
    if result is not None and result.differences:
        return (
            "Keep the described numbers, and take the rotation from a gyro or positions: the slip differs by "
            "motion."
        )
    if _of_slip(diagnosis.slip):
        return (
            "Measure the slip while driving, by a camera that sees the ground or positions, or state it in "
            "[ground]: diagnose two drives or more on this ground together."
        )
    first = next((each for each in diagnosis.not_shown if each.shown_by), None)
    if first is not None:
        return f"Record what would show {first.what}: {first.shown_by}."
    return _without_change(diagnosis)


def _without_change(diagnosis: Diagnosis) -> str:
    """Return the next step where nothing is shown to be wrong."""
    if any(each.drive.channels.has_computed_wheels for each in diagnosis.drives):
        return (
            "Import the wheels themselves ([[wheel]], with steering where one steers): from a path no number "
            "of the rover can be corrected."
        )
    if diagnosis.geometry.result is None:
        return f"Nothing is shown that needs a change; geometry cannot be known: {diagnosis.geometry.reason}."
    return "Nothing needs to be changed."
