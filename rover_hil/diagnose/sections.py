"""The diagnosis in words and tables, in the order of the page, and as a record for programs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from rover_hil.diagnose.answer import answer_of, distance_words, rotation_words
from rover_hil.diagnose.covariance import by_kind
from rover_hil.diagnose.diagnosis import Diagnosis
from rover_hil.diagnose.drive_errors import ESTIMATE, ODOMETRY, Errors, TrackErrors
from rover_hil.diagnose.geometry import TO_PASTE, settings_text
from rover_hil.diagnose.intervals import short
from rover_hil.diagnose.recorded import Recording, recordings_of
from rover_hil.diagnose.twin import Twin
from rover_hil.drives.formats.table.columns import Columns
from rover_hil.drives.quality.consistency import Consistency
from rover_hil.ready.procedure import Entry
from rover_hil.recording.findings import finding_lines

Row = Sequence[str]
ERROR_COLUMNS = ("drive", "motion", "m", "rotations", "ATE m", "RPE m per m", "RPE deg")
"""Errors: those of the odometry / those of the estimate; one number where both are alike."""
TOGETHER = "together"
GROUND_WORDS = "# slip: share of the travel of the wheels that is lost; cross_slip: that goes to the side"
ONLY_CONFIGURATION = "# for a configuration; a file of columns does not take what follows"


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of the page.

    Attributes:
        title: Its heading.
        lines: Sentences.
        table: Heading and rows; empty for none.
        text: To paste; "" for none.
    """

    title: str
    lines: Sequence[str] = ()
    table: Sequence[Row] = ()
    text: str = ""


def sections_of(diagnosis: Diagnosis, twin: Twin | None) -> list[Section]:
    """Return the parts of the page, in order, without the answer."""
    return [
        _recorded(diagnosis),
        _findings(diagnosis),
        _geometry(diagnosis),
        _errors(diagnosis),
        _covariance(diagnosis),
        _measurements(diagnosis),
        _slip(diagnosis),
        _twin(twin),
    ]


def error_table(diagnosis: Diagnosis) -> list[Row]:
    """Return heading and rows of the errors, one row for each drive and one for all."""
    rows: list[Row] = [ERROR_COLUMNS]
    errors = diagnosis.errors
    for each in diagnosis.drives:
        of_drive = {} if errors is None else errors.of_drives.get(each.name, {})
        rows.append((each.name, each.kind, *_driven(each.distance_m, each.rotations), *_cells(of_drive)))
    if errors is not None and len(diagnosis.drives) > 1:
        distance_m = sum(each.distance_m for each in diagnosis.drives)
        rotations = sum(each.rotations for each in diagnosis.drives)
        rows.append((TOGETHER, "", *_driven(distance_m, rotations), *_cells(errors.together)))
    return rows


def error_notes(diagnosis: Diagnosis) -> list[str]:
    """Return what the columns of the errors mean; nothing where the errors are not known."""
    if diagnosis.errors is None:
        return []
    degrees = math.degrees(diagnosis.errors.part_rad)
    return [
        "ATE (absolute trajectory error): distance from the ground truth after the whole path is moved and "
        f"turned onto it; RPE (relative pose error): error of the motion over 1 m, and over {degrees:.0f} "
        "deg of rotation; root mean square, as evo defines them; odometry / estimate, or one number where "
        "both are alike",
    ]


def _driven(distance_m: float, rotations: float) -> tuple[str, str]:
    return f"{distance_m:.1f}", f"{rotations:.1f}"


def _cells(tracks: Mapping[str, TrackErrors]) -> tuple[str, ...]:
    odometry, estimate = tracks.get(ODOMETRY), tracks.get(ESTIMATE)
    if odometry is None or estimate is None:
        return ("-",) * 3
    pairs = (
        (odometry.ate_m, estimate.ate_m),
        (odometry.rpe_m, estimate.rpe_m),
        (math.degrees(odometry.rpe_rad), math.degrees(estimate.rpe_rad)),
    )
    return tuple(_pair(short(one), short(other)) for one, other in pairs)


def _pair(odometry: str, estimate: str) -> str:
    return odometry if odometry == estimate else f"{odometry} / {estimate}"


def _recorded(diagnosis: Diagnosis) -> Section:
    rows = [row for each in diagnosis.drives for row in recordings_of(each)]
    kinds = [each.kind for each in diagnosis.drives]
    lines = [f"kinds of motion: {', '.join(f'{kind} {kinds.count(kind)}' for kind in dict.fromkeys(kinds))}"]
    lines += [_rate_words(rows)]
    lines += [f"cannot be known: {each.words}" for each in diagnosis.not_shown]
    return Section(title="What was recorded, and what it cannot show", lines=lines)


def _rate_words(rows: Sequence[Recording]) -> str:
    words = []
    for quantity in dict.fromkeys(row.quantity for row in rows):
        of = [row for row in rows if row.quantity == quantity]
        slowest, gap = min(row.rate_hz for row in of), max(of, key=lambda row: row.longest_gap_s)
        words.append(f"{quantity} {slowest:.3g} Hz, longest gap {gap.longest_gap_s:.2g} s in {gap.drive}")
    return f"recorded: {'; '.join(words)}"


def _findings(diagnosis: Diagnosis) -> Section:
    lines: list[str] = []
    several = len(diagnosis.drives) > 1
    for each in diagnosis.drives:
        name = f"{each.name}: " if several else ""
        lines += [f"{name}{line}" for finding in each.findings for line in finding_lines(finding)]
        lines += [
            f"{name}data: {_odd_words(odd)}"
            for odd in each.drive.channels.import_findings
            if odd["count"] is not None
        ]
    none = "none: no sensor contradicts another beyond what noise and slip explain"
    return Section(title="Findings", lines=lines or [none])


def _odd_words(odd: Mapping[str, object]) -> str:
    """Return a data-quality finding: what, where, how often, and what was done."""
    where = f", {odd['where']}" if odd["where"] else ""
    times = "" if odd["count"] == 1 else f" ({odd['count']} times)"
    return f"{odd['what']}{where}{times}: {odd['done']}"


def _geometry(diagnosis: Diagnosis) -> Section:
    part = diagnosis.geometry
    if part.result is None:
        return Section(title="Geometry and sensors", lines=[f"cannot be known: {part.reason}"])
    lines = [f"{name}: {value}" for name, value in part.facts if name != TO_PASTE]
    pasted = [value for name, value in part.facts if name == TO_PASTE]
    settings = paste_sections(diagnosis)
    words = f"{ONLY_CONFIGURATION}\n{GROUND_WORDS}" if "ground" in settings else ONLY_CONFIGURATION
    pasted += [f"{words}\n{settings_text(settings)}"] if settings else []
    return Section(title="Geometry and sensors", lines=lines, text="\n\n".join(pasted))


def paste_sections(diagnosis: Diagnosis) -> dict[str, dict[str, object]]:
    """Return the accepted settings of ground and filter, by section of a configuration."""
    settings = diagnosis.settings
    if settings is None or not settings.is_accepted:
        return {}
    sections: dict[str, dict[str, object]] = {}
    if settings.yaw_noise:
        sections["filter"] = dict(settings.yaw_noise)
    if settings.ground is not None:
        names = ", ".join(each.name for each in diagnosis.drives[:3])
        more = len(diagnosis.drives) - 3
        source = f"diagnose {names}{f' and {more} more' if more > 0 else ''}"
        sections["ground"] = dict(settings.ground.settings(source))
    return sections


def entries_of(diagnosis: Diagnosis, columns: Columns | None) -> list[Entry]:
    """Return what is accepted, for a configuration or a file of columns, which has [rover] only."""
    entries = list(diagnosis.geometry.entries)
    if columns is not None:
        return entries
    for section, keys in paste_sections(diagnosis).items():
        entries += [Entry(section, key, value) for key, value in keys.items()]  # type: ignore[arg-type]
    return entries


def _errors(diagnosis: Diagnosis) -> Section:
    errors = diagnosis.errors
    title = "Odometry and estimate against the ground truth"
    if errors is None:
        return Section(title=title, lines=[f"cannot be known: {diagnosis.why_no_errors}"])
    sources = ", ".join(dict.fromkeys(each.source for each in diagnosis.drives if each.source))
    lines = [
        f"compared with: {sources}",
        f"odometry: {distance_words(errors, ODOMETRY)}, over parts of {errors.part_m:g} m",
        f"estimate: {distance_words(errors, ESTIMATE)}",
        *_rotation_lines(errors),
        *error_notes(diagnosis),
    ]
    if any(each.truth is not None and each.truth.yaw_rad is None for each in diagnosis.drives):
        lines.append("positions without yaw: RPE is that of the distance, errors of the yaw cannot be known")
    if not all(each.is_independent for each in diagnosis.drives if each.truth is not None):
        lines.append("the estimate has used the positions that it is compared with: its errors are too small")
    return Section(title=title, lines=lines, table=error_table(diagnosis))


def _rotation_lines(errors: Errors) -> list[str]:
    if not errors.per_rotation_rad[ODOMETRY].count:
        return []
    over = f"over parts of {math.degrees(errors.part_rad):.0f} deg"
    return [
        f"odometry turns {rotation_words(errors, ODOMETRY)}, {over}",
        f"estimate turns {rotation_words(errors, ESTIMATE)}",
    ]


def _covariance(diagnosis: Diagnosis) -> Section:
    title = "Is the standard deviation honest?"
    covariance, settings = diagnosis.covariance, diagnosis.settings
    if covariance is None:
        why = "it needs ground truth with a yaw that neither the estimate nor the wheels have used"
        return Section(title=title, lines=[f"cannot be known: {why}"])
    table: list[Row] = [("motion", "standard deviation", "too small by", "95 %")]
    kinds = {**by_kind(diagnosis.normalised), TOGETHER: covariance}
    table += [
        (kind, each.words("poses"), short(each.growth), " to ".join(map(short, each.interval)))
        for kind, each in kinds.items()
    ]
    lines = [f"the standard deviation {_verdict(covariance)}"]
    if settings is None:
        lines.append("settings that would be right cannot be known before the findings are corrected")
        return Section(title=title, lines=lines, table=table)
    if settings.ground is not None:
        lines.append(f"the ground by the wheels: {settings.ground.words}")
    if settings.yaw_noise:
        values = ", ".join(f"{key} = {value:g}" for key, value in settings.yaw_noise.items())
        lines.append(f"noise of the yaw by the wheels: [filter] {values}")
    if settings.before is not None and settings.after is not None:
        names = ", ".join(settings.validated_on)
        taken = "accepted" if settings.is_accepted else "not accepted: no better there"
        lines.append(
            f"on validation drives ({names}) the standard deviation {_verdict(settings.before)} without "
            f"these settings, and {_verdict(settings.after)} with them: {taken}"
        )
    elif covariance.is_too_small or covariance.is_too_large:
        lines.append("the settings are not validated: give two drives or more")
    return Section(title=title, lines=lines, table=table)


def _verdict(covariance: Consistency) -> str:
    """Return whether a standard deviation holds, from the verb on."""
    verdict, _, why = covariance.words("poses").partition(": ")
    return f"{'' if verdict == 'holds' else 'is '}{verdict} ({why})"


def _measurements(diagnosis: Diagnosis) -> Section:
    lines = [f"{each.device}: {each.words}" for each in diagnosis.measurements]
    errors = diagnosis.errors
    if errors is not None:
        lines += [
            f"without {device}, in the longest drives: ATE {ate_m:.3g} m instead of {whole_m:.3g} m"
            for device, (ate_m, whole_m) in diagnosis.without.items()
        ]
    return Section(
        title="Measurements that correct the estimate",
        lines=lines or ["none: no sensor but wheels and gyro is used"],
    )


def _slip(diagnosis: Diagnosis) -> Section:
    lines = [
        f"{kind}: {slip.times(100.0).words('%')} of the wheels' travel is lost"
        for kind, slip in diagnosis.slip.items()
    ]
    if not lines:
        lines = ["cannot be known: it needs ground truth with a yaw that is not from the wheels"]
    lines.append(f"missing effect, by `rover-hil gap rover`: {diagnosis.gap}")
    return Section(title="Slip by kind of motion", lines=lines)


def _twin(twin: Twin | None) -> Section:
    title = "The simulated twin"
    if twin is None:
        return Section(title=title, lines=["none: name with --config a configuration with [simulation]"])
    lines = [each.words for each in twin.numbers] or ["none: these drives show no number of it"]
    lines += [f"not written: {each.name} ({each.why})" for each in twin.unknown]
    return Section(title=title, lines=lines)


def record_of(diagnosis: Diagnosis, twin: Twin | None) -> dict[str, object]:
    """Return the diagnosis for a program."""
    errors, settings = diagnosis.errors, diagnosis.settings
    covariance = diagnosis.covariance
    return {
        "answer": asdict(answer_of(diagnosis)),
        "drives": [
            {
                "name": each.name,
                "log": str(each.drive.log.path),
                "motion": each.kind,
                "distance_m": each.distance_m,
                "rotations": each.rotations,
                "compared_with": each.source or None,
                "findings": [asdict(finding) for finding in each.findings],
                "recorded": [asdict(row) for row in recordings_of(each)],
            }
            for each in diagnosis.drives
        ],
        "not_shown": [asdict(each) for each in diagnosis.not_shown],
        "geometry": {
            "is_accepted": diagnosis.geometry.is_accepted,
            "reason": diagnosis.geometry.reason,
            "harms": dict(diagnosis.geometry.harms),
            **diagnosis.geometry.numbers,
        },
        "errors": None if errors is None else asdict(errors),
        "covariance": None if covariance is None else asdict(covariance),
        "covariance_by_motion": {kind: asdict(each) for kind, each in by_kind(diagnosis.normalised).items()},
        "settings": None
        if settings is None
        else {
            "is_accepted": settings.is_accepted,
            "ground": None if settings.ground is None else settings.ground._asdict(),
            "filter": dict(settings.yaw_noise),
            "before": None if settings.before is None else asdict(settings.before),
            "after": None if settings.after is None else asdict(settings.after),
            "validated_on": list(settings.validated_on),
        },
        "measurements": [asdict(each) for each in diagnosis.measurements],
        "ate_without_m": {
            device: {"without": ate_m, "with": whole_m}
            for device, (ate_m, whole_m) in diagnosis.without.items()
        },
        "slip": {kind: asdict(each) for kind, each in diagnosis.slip.items()},
        "gap": diagnosis.gap,
        "twin": None
        if twin is None
        else {**twin.found, "not_written": {each.name: each.why for each in twin.unknown}},
    }
