"""The factor from the travel that a camera measures to the true one, with its interval.

Height, pitch and focal length of the camera act on the travel as one factor. Pieces of the drive of equal
length give it by least squares through zero. Their scatter, the accuracy of fixes, and the tolerance of what
is known make the interval.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from controllers.estimation.ground.travel import WHEELS_SD
from rover_hil.ready.scale.record import CameraTravels
from rover_hil.ready.wheels.fit import NORMAL_95, Factor, fit_factor

PIECE_M = 0.5
"""Errors of neighbouring pairs of frames are alike, those of pieces of this length are not."""
LEAST_PIECES = 3
STRAIGHT = 0.9
"""Least distance between the ends of a piece, over its length: fixes and camera see turns from elsewhere."""
GREATEST_CHANGE = 0.15
"""A factor further from 1 is a mistake in the rig, not a tolerance."""
GREATEST_HALF_WIDTH = 0.03
"""A factor that is less certain says no more than the tolerances of a rig."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleFit:
    """The factor.

    Attributes:
        factor: True travel over that of the camera, with its interval; None with too few pieces.
        distance_m: Travel of all pieces.
        sideways_deg: Angle from the known course to that of the camera, on average.
        problem: Why the factor must not be used; empty where it may.
    """

    factor: Factor | None
    distance_m: float
    sideways_deg: float
    problem: str

    @property
    def sd(self) -> float:
        """Standard deviation of the factor."""
        return math.nan if self.factor is None else self.factor.half_width / NORMAL_95


def fit_scale(records: Sequence[CameraTravels]) -> ScaleFit:
    """Return the factor of one camera from one or more drives."""
    pieces = [piece for record in records for piece in _pieces(record)]
    known = [abs(known_m) for known_m, _ in pieces]
    if len(pieces) < LEAST_PIECES:
        reasons = sum((Counter(record.reasons) for record in records), Counter())
        why = f" ({reasons.most_common(1)[0][0]})" if reasons else ""
        problem = (
            f"{len(pieces)} pieces of {PIECE_M:g} m of straight travel were measured, {LEAST_PIECES} are "
            f"needed{why}: drive further"
        )
        return ScaleFit(factor=None, distance_m=sum(known), sideways_deg=math.nan, problem=problem)
    # Only travel along the known course counts: the rest is a turned camera, or noise of fixes.
    along = [(camera_m * known_m.conjugate()).real / abs(known_m) for known_m, camera_m in pieces]
    product = sum(camera_m * known_m.conjugate() for known_m, camera_m in pieces)
    sideways_deg = math.degrees(math.atan2(product.imag, product.real))
    accuracy_m = math.sqrt(2.0) * max(record.known_sd_m for record in records)
    scatter = fit_factor(known, along, accuracy_m)
    factor = Factor(
        value=scatter.value,
        half_width=math.hypot(scatter.half_width, NORMAL_95 * WHEELS_SD),
        measured=scatter.measured,
        odometry=scatter.odometry,
    )
    return ScaleFit(factor=factor, distance_m=sum(known), sideways_deg=sideways_deg, problem=_problem(factor))


def _problem(factor: Factor) -> str:
    if abs(factor.value - 1.0) > GREATEST_CHANGE:
        return (
            f"the camera measures {1.0 / factor.value:.3g} times the travel: correct height, pitch or focal "
            "length of the rig, or the wheels' radius, first"
        )
    if factor.half_width > GREATEST_HALF_WIDTH:
        return (
            f"the factor is uncertain by {100 * factor.half_width:.1f} %: "
            "drive further, on ground that does not slip"
        )
    return ""


def _pieces(record: CameraTravels) -> list[tuple[complex, complex]]:
    """Return straight pieces of the drive of equal length: known travel and that of the camera.

    Travels are added in the axes of each frame: a rover that turns by some degrees within a piece still moves
    along its own axes.
    """
    pieces = []
    known_m = camera_m = 0j
    length_m = 0.0
    for travel in record.travels:
        if travel.camera_m is None or not math.isfinite(abs(travel.known_m)):
            known_m = camera_m = 0j
            length_m = 0.0
            continue
        known_m += travel.known_m
        camera_m += travel.camera_m
        length_m += abs(travel.camera_m)
        if length_m >= PIECE_M:
            if abs(camera_m) > STRAIGHT * length_m:
                pieces.append((known_m, camera_m))
            known_m = camera_m = 0j
            length_m = 0.0
    return pieces
