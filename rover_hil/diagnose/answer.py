"""The answer of a diagnosis: what the odometry is worth, the most harmful cause, and what to do next."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from rover_hil.diagnose.covariance import by_kind
from rover_hil.diagnose.diagnosis import SMALL_HARM, Diagnosis, FoundCause
from rover_hil.diagnose.drive_errors import ESTIMATE, LEFT, ODOMETRY, RIGHT, Errors
from rover_hil.diagnose.geometry import GeometryPart, number_words
from rover_hil.diagnose.intervals import Interval, short
from rover_hil.diagnose.recorded import OTHER_KINDS
from rover_hil.ready.wheels.drives_procedure import UNITS, estimate_words
from rover_hil.ready.wheels.from_drives import WRONG_TOGETHER

LEAST_SCALE = 0.002
"""A smaller error of the scale of a gyro turns the estimate by less than a degree per rotation."""
LEAST_SLIP = 0.02
"""A smaller share of the travel is that of a hard floor, see [ground] slip = "firm"."""
BETTER_WITHOUT = 0.7
"""The estimate is better without a sensor where its error is smaller than this share of that with it."""


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


def answer_of(diagnosis: Diagnosis) -> Answer:
    """Return the three sentences."""
    return Answer(
        worth=_worth(diagnosis),
        cause=_cause(diagnosis),
        next_step=_for_ground_truth(diagnosis) or _next_step(diagnosis),
    )


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
    length = "" if errors.per_rotation_rad[ODOMETRY].count else " of length"
    turn = errors.per_rotation_rad[ODOMETRY]
    has_yaw = any(each.truth is not None and each.truth.yaw_rad is not None for each in drives)
    why = "the drives rotate too little" if has_yaw else "no known place has a yaw of its own"
    rotation = f"the error per rotation is not known, because {why}"
    if turn.count:
        rotation = f"turns {rotation_words(errors, ODOMETRY)}"
    used = "" if all(each.is_independent for each in drives) else ", by positions that it has used"
    odometry, estimate = distance_words(errors, ODOMETRY, length), distance_words(errors, ESTIMATE)
    return (
        f"In {driven}, the odometry is off by {odometry}, measured over parts of {errors.part_m:g} m, and "
        f"{rotation}; the estimate is off by {estimate}{used}."
    )


def distance_words(errors: Errors, track: str, what: str = "") -> str:
    """Return by how much a track is off per 100 m; `what` names an error that is not that of the place."""
    error = errors.per_100_m[track]
    return f"{error.words('m')}{what} per 100 m" if error.count else "an unknown distance (too short drives)"


def rotation_words(errors: Errors, track: str) -> str:
    """Return by how much a track turns too far or too little per rotation, by side where these differ.

    An error of the scale (track, radius) turns too far to both sides or too little to both, a bias (steering
    zero, wheels of two radii) too far to one side and too little to the other: their mean would hide it.
    """
    left, right = (errors.per_rotation_to_rad[track][side] for side in (LEFT, RIGHT))
    if left.count and right.count and (left.value * right.value < 0.0 or not left.agrees_with(right)):
        return f"{_turns(left)} per rotation to the left, and {_turns(right)} to the right"
    absent = [side for side, turn in ((LEFT, left), (RIGHT, right)) if not turn.count]
    only = f", none of them to the {absent[0]}" if len(absent) == 1 else ""
    return f"{_turns(errors.per_rotation_rad[track])} per rotation{only}"


def _turns(turn: Interval) -> str:
    if turn.value < 0.0:
        return f"{_degrees(turn, -1.0).words('deg')} too little"
    return f"{_degrees(turn).words('deg')} too far"


def _degrees(interval: Interval, sign: float = 1.0) -> Interval:
    return interval.times(sign * math.degrees(1.0))


def _cause(diagnosis: Diagnosis) -> str:
    """Return the most harmful cause, in one sentence."""
    causes = diagnosis.causes
    if causes and not diagnosis.has_worse_wheels:
        return f"Most harmful {_of_finding(causes[0], diagnosis)}."
    wheels = _of_wheels(diagnosis)
    return f"{wheels}; {_of_finding(causes[0], diagnosis)}." if causes else f"{wheels}."


def _of_finding(cause: FoundCause, diagnosis: Diagnosis) -> str:
    """Return a finding of whole drives, in how many it is, and how much of the motion it concerns."""
    harm = cause.finding.harm
    share = "" if not harm or harm >= SMALL_HARM else f", {100.0 * harm:.2g} % of the motion"
    return f"in {len(cause.drives)} of {len(diagnosis.drives)} drives{share}: {cause.finding.text}"


def _of_wheels(diagnosis: Diagnosis) -> str:
    """Return what is wrong with wheels or sensors where no finding is worse."""
    geometry, slip = _of_geometry(diagnosis.geometry), _of_slip(diagnosis.slip)
    result = diagnosis.geometry.result
    is_known = diagnosis.geometry.is_accepted or diagnosis.geometry.is_shared
    has_geometry = is_known or (result is not None and bool(result.differences))
    # A number that is not accepted may be slip.
    found = geometry if has_geometry else slip or geometry
    found = found or slip or _of_rotation(diagnosis.errors)
    of_sensors = "; ".join([*_of_gyro(diagnosis.geometry), *_of_harmful(diagnosis.without)])
    if of_sensors:
        return f"{found}; {of_sensors}" if found else f"Most harmful: {of_sensors}"
    return found or _of_estimate(diagnosis)


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
    if geometry.is_shared:
        errors = ", ".join(f"{short(each.end_m[0])} -> {short(each.end_m[1])} m" for each in result.by_kind)
        numbers = ", ".join(f"{each.number.name} {estimate_words(each)}" for each in result.shown)
        return (
            f"Most harmful: {WRONG_TOGETHER} ({numbers}), which explains the error at the end of validation "
            f"drives ({errors}); these drives do not show which of them"
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
    if errors is None:
        return ""
    turn, sides = errors.per_rotation_rad[ODOMETRY], errors.per_rotation_to_rad[ODOMETRY]
    far, little = sorted(sides, key=lambda side: -sides[side].value)
    if sides[far].low > 0.0 > sides[little].high:
        return (
            f"Most harmful: the wheels turn too far to the {far} and too little to the {little}, by the zero "
            "of a steering, radii that differ, or slip; these drives do not show which"
        )
    if not turn.is_known or turn.low <= 0.0 <= turn.high:
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


def _for_ground_truth(diagnosis: Diagnosis) -> str:
    """Return what would replace ground truth that comes from the wheels; "" where there is other."""
    if diagnosis.errors is not None or not any(each.copied for each in diagnosis.drives):
        return ""
    return (
        "Give places that something else has measured, as [truth] or [fixes] (an overhead camera, GNSS, "
        "marks, positions computed from ranges): those of these drives come from the wheels."
    )


def _next_step(diagnosis: Diagnosis) -> str:
    """Return what to do next, in one sentence."""
    if diagnosis.causes:
        return _about_findings(diagnosis)
    if diagnosis.geometry.is_shared:
        return f"Record what would show which number is wrong: {_to_show(diagnosis.geometry)}."
    if diagnosis.geometry.is_accepted:
        others = next((each.shown_by for each in diagnosis.not_shown if each.what == OTHER_KINDS), "")
        more = f", and record {others}, which would show whether they hold there" if others else ""
        return f"Enter the corrected numbers (--config FILE --enter, or paste them){more}."
    settings = diagnosis.settings
    if settings is not None and settings.is_accepted:
        return (
            "Enter the settings of the ground and the filter into a configuration (--config FILE --enter, or "
            "paste them); a file of columns does not take them."
        )
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


def _about_findings(diagnosis: Diagnosis) -> str:
    """Return the next step where a finding of whole drives stands."""
    if diagnosis.has_worse_wheels:
        return (
            "Enter the corrected numbers (--config FILE --enter, or paste them), correct what the finding "
            "states, and diagnose again."
        )
    harm = diagnosis.causes[0].finding.harm
    if harm is None or harm >= SMALL_HARM:
        return "Correct this first, as the finding states, and diagnose again: other numbers depend on it."
    return (
        f"Correct this, as the finding states: it concerns {100.0 * harm:.2g} % of the motion, and changes "
        "the other numbers little."
    )


def _to_show(geometry: GeometryPart) -> str:
    """Return which drives would show the numbers of the wheels."""
    assert geometry.result is not None  # noqa: S101 the callers have checked it
    return "; ".join(dict.fromkeys(each.number.shown_by for each in geometry.result.shown))


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
