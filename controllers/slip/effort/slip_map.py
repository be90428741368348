"""Slip of a wheel from its effort: the forms of map, and their evaluation. Plain floats."""

import math
from datetime import date
from typing import Annotated, Literal, NamedTuple, Self, TypeAlias

from pydantic import Field, JsonValue, model_validator

from controllers.slip.effort.motor_model import MotorSettings, WheelEffort
from controllers.slip.effort.surface_map import SurfaceMap
from controllers.slip.interpolation import check_rising, interpolate
from drivers.settings import Settings

Feature = Literal["paper_torque_nm", "current_a", "wheel_torque_nm"]
"""Quantity of a wheel's effort that a map reads, positive where the motor drives the wheel onwards."""


class SlipEstimate(NamedTuple):
    """Slip ratio of one wheel, and whether it may be used.

    Attributes:
        slip: 1 - effective speed / measured speed, -1 to 1. Outside the map's range it is the value at its
            end, and `valid` is False.
        valid: False outside what the map was trained on, and where the effort itself is flagged.
        reason: Why it is not valid; empty where it is.
    """

    slip: float
    valid: bool
    reason: str


class MapSettings(Settings):
    """Common part of the maps of one wheel.

    Attributes:
        feature: Quantity that the map reads.
        valid_from: Least value of the feature in the training data.
        valid_to: Greatest.
    """

    feature: Feature
    valid_from: float
    valid_to: float

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if self.valid_to <= self.valid_from:
            raise ValueError(f"valid_to ({self.valid_to:g}) must be greater than valid_from")
        return self


class PolynomialMap(MapSettings):
    """Slip = c0 + c1 x (+ c2 x^2); the paper's map is the linear one over M.

    Attributes:
        coefficients: Lowest power first, two or three.
    """

    kind: Literal["polynomial"] = "polynomial"
    coefficients: Annotated[tuple[float, ...], Field(min_length=2, max_length=3)]


class MonotoneMap(MapSettings):
    """A table that never falls (isotonic regression), linear between its points.

    Attributes:
        points: Values of the feature, increasing.
        slips: Slip at each, not decreasing.
    """

    kind: Literal["monotone"] = "monotone"
    points: Annotated[tuple[float, ...], Field(min_length=2)]
    slips: Annotated[tuple[float, ...], Field(min_length=2)]

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        check_rising("points", self.points, "slips", self.slips)
        return self


class TractionMap(MapSettings):
    """Inverse of the traction curve x = x_max (1 - exp(-s / s0)): slip = -s0 ln(1 - x / x_max).

    Traction saturates: near x_max a little more effort means any slip, and the slip is cut at 1.

    Attributes:
        greatest: x_max, in the unit of the feature.
        slip_scale: s0.
    """

    kind: Literal["traction"] = "traction"
    greatest: Annotated[float, Field(gt=0.0)]
    slip_scale: Annotated[float, Field(gt=0.0)]


WheelMap: TypeAlias = Annotated[PolynomialMap | MonotoneMap | TractionMap, Field(discriminator="kind")]


def wheel_slip(wheel_map: WheelMap, effort: WheelEffort) -> SlipEstimate:
    """Return the slip of a wheel with this effort."""
    value = feature_value(wheel_map.feature, effort)
    slip = slip_at(wheel_map, value)
    if effort.flags:
        return SlipEstimate(slip, False, effort.flags[0].value)
    if not wheel_map.valid_from <= value <= wheel_map.valid_to:
        reason = f"{wheel_map.feature} of {value:.3g} is outside the training range"
        return SlipEstimate(slip, False, reason)
    return SlipEstimate(slip, True, "")


def feature_value(feature: Feature, effort: WheelEffort) -> float:
    """Return the quantity that a map reads, positive where the motor drives the turning wheel onwards."""
    value: float = getattr(effort, feature)
    return value * math.copysign(1.0, effort.speed_rad_s)


def slip_at(wheel_map: WheelMap, value: float) -> float:
    """Return the slip for a value of the feature, held at the ends of the valid range, within -1 to 1."""
    inside = max(wheel_map.valid_from, min(wheel_map.valid_to, value))
    match wheel_map:
        case PolynomialMap():
            slip = sum(factor * inside**power for power, factor in enumerate(wheel_map.coefficients))
        case MonotoneMap():
            slip = interpolate(wheel_map.points, wheel_map.slips, inside)
        case TractionMap():
            reserve = 1.0 - inside / wheel_map.greatest
            slip = 1.0 if reserve <= 0.0 else -wheel_map.slip_scale * math.log(reserve)
    return max(-1.0, min(1.0, slip))


class MapScore(Settings):
    """Distance error as a fraction of encoder distance over whole runs, in cross-validation.

    Attributes:
        rms: Root mean square.
        bias: Mean; positive means that the map overestimates the distance.
        n: Number of runs.
    """

    rms: float
    bias: float
    n: int


class SlipMapFile(Settings):
    """Fitted slip maps and where they come from.

    Attributes:
        source: The data they were fitted to.
        fitted_on: Day of the fit.
        licence: Of the data.
        slip_unit: Slip is a ratio.
        scale_mm_per_px: Camera scale of the fit; None where the truth was given in metres.
        motor: The motor that turned currents into torques; a map holds for these numbers only.
        wheel_maps: Maps of one wheel for all surfaces together, by name.
        surface_wheel_maps: Isotonic maps over the wheel's torque for each surface, by its name.
        surfaces: The map that recognises the surface; the best one without yaw excitation.
        yaw_probe: Fit of earlier versions to a yaw excitation; not used, the excitation needs no fit.
        cross_validation: Score of each map within the training data.
    """

    source: str
    fitted_on: date
    licence: str
    slip_unit: Literal["1"] = "1"
    scale_mm_per_px: float | None = None
    motor: MotorSettings
    wheel_maps: dict[str, WheelMap]
    surface_wheel_maps: dict[str, WheelMap]
    surfaces: SurfaceMap
    yaw_probe: dict[str, JsonValue] | None = None
    cross_validation: dict[str, MapScore]
