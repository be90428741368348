"""All that drives show: errors, geometry, covariance and sensors."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controllers.motion.kinematics import make_kinematics
from drivers.samples import Sample
from rover_hil.config import Config
from rover_hil.diagnose.covariance import (
    Normalised,
    Settings,
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
from rover_hil.diagnose.geometry import GeometryPart, fit_geometry
from rover_hil.diagnose.intervals import Interval, mean_of
from rover_hil.diagnose.recorded import (
    Measurements,
    NotShown,
    measurements_of,
    not_shown,
)
from rover_hil.diagnose.replayed_drive import COPIED_DISTANCE, ReplayedDrive, replay_drive, replay_of
from rover_hil.diagnose.trajectory_errors import Trajectory, absolute_errors
from rover_hil.drives.arrays import Array, rms
from rover_hil.drives.quality.clock_check import CLOCK, clock_findings
from rover_hil.drives.quality.consistency import Consistency
from rover_hil.drives.quality.drive_paths import path_of_wheels
from rover_hil.ready.wheels.geometry import BASES
from rover_hil.recording.findings import FoundFinding

SMALL_HARM = 0.05
"""A finding of a smaller share of the motion changes the other numbers little."""
CONTRADICTS = 0.3
"""A finding of a greater share leaves no number of the wheels to be fitted."""
HELD_OUT_EVERY = 3
MOST_LEFT_OUT = 2
"""More drives are not replayed again without each sensor."""
MOST_VALIDATED = 3
"""More drives are not replayed again with other settings."""
Report = Callable[[str, Path, int], None]
"""Gets what is being done, the log, and how many bytes of it are read."""


class FoundCause(NamedTuple):
    """A finding of whole drives.

    Attributes:
        finding: Where it does most harm.
        drives: Names of the drives that have it.
        harm: Mean share of the motion of all drives that is wrong because of it; 1 where it is not known.
    """

    finding: FoundFinding
    drives: Sequence[str]
    harm: float


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
    def causes(self) -> list[FoundCause]:
        """Findings of whole drives, each once, the most harmful first."""
        found: dict[str, dict[str, FoundFinding]] = {}
        for each in self.drives:
            for finding in _of_whole_drives(each):
                found.setdefault(finding.name, {})[each.name] = finding
        causes = [
            FoundCause(
                finding=max(of_drives.values(), key=_harm),
                drives=list(of_drives),
                harm=sum(map(_harm, of_drives.values())) / len(self.drives),
            )
            for of_drives in found.values()
        ]
        return sorted(causes, key=lambda each: -each.harm)

    @property
    def has_worse_wheels(self) -> bool:
        """Whether wrong numbers of the wheels, which are corrected, do more harm than any finding."""
        if not self.geometry.is_accepted or self.errors is None:
            return False
        harm = self.errors.per_100_m[ODOMETRY].value / 100.0
        return all(each.harm < harm for each in self.causes)


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
    geometry = _geometry_of(drives)
    drives = [_with_clocks(each, geometry) for each in drives]
    compared = _all_compared(drives, geometry)
    normalised = [
        found
        for each in drives
        if each.name in compared
        and (found := normalised_errors(each, each.replay, compared[each.name])) is not None
    ]
    corrected = _with_wheels(compared, geometry) if geometry.is_accepted else compared
    return Diagnosis(
        drives=drives,
        compared=compared,
        errors=errors_of(compared),
        geometry=geometry,
        normalised=normalised,
        settings=_settings(drives, corrected, normalised, geometry, report),
        measurements=measurements_of(drives),
        without={} if is_quick else _without_each(drives, compared, geometry, report),
        slip=_slip(drives, _with_wheels(compared, geometry)),
        gap="not asked: --quick" if is_quick else _gap(drives, compared, geometry, report),
        not_shown=not_shown(drives, geometry),
    )


def _of_whole_drives(each: ReplayedDrive) -> list[FoundFinding]:
    return [finding for finding in each.findings if finding.t_s is None]


def _harm(finding: FoundFinding) -> float:
    return 1.0 if finding.harm is None else finding.harm


def _hinders(each: ReplayedDrive) -> bool:
    """Return whether a finding of the whole drive makes other numbers wrong."""
    return any(_harm(finding) >= SMALL_HARM for finding in _of_whole_drives(each))


def _geometry_of(drives: Sequence[ReplayedDrive]) -> GeometryPart:
    """Return the geometry, unless wheels or places contradict each other altogether."""
    for each in drives:
        for finding in _of_whole_drives(each):
            if finding.harm is not None and finding.harm > CONTRADICTS:
                return GeometryPart(
                    reason=f"it waits until the finding of {each.name} is corrected, which hides the numbers "
                    "of the wheels"
                )
    return fit_geometry(drives)


def _with_clocks(each: ReplayedDrive, geometry: GeometryPart) -> ReplayedDrive:
    """Return a drive with what its clocks show by the corrected wheels: wrong wheels hide it."""
    result = geometry.result
    is_known = any(finding.name == CLOCK for finding in _of_whole_drives(each))
    if result is None or not geometry.is_accepted or is_known:
        return each
    kinematics = make_kinematics(result.corrected)
    path = path_of_wheels(each.drive.channels, kinematics)
    found = [
        replace(finding, text=f"with the corrected wheels, {finding.text}")
        for finding in clock_findings(each.drive.channels, kinematics, path)
    ]
    return replace(each, findings=[*found, *each.findings])


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
    """Return the drives with their odometry by the wheels that are better on validation drives, if any."""
    if not (geometry.is_accepted or geometry.is_shared):
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
    if not normalised or (not slips and any(map(_hinders, drives))):
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
    if any(map(_hinders, drives)):
        return "not asked before the findings are corrected"
    longest = sorted((each for each in drives if each.name in compared), key=lambda each: -each.distance_m)
    config = _corrected(drives[0].drive.config, geometry)
    answer = gap_answer(
        [each.drive.log.path for each in longest],
        config,
        lambda step: report(f"gap rover: {step}", Path(), 0),
    )
    return answer if config is drives[0].drive.config else f"with the corrected wheels, {answer}"
