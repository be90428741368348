"""Recognition of the surface, and its slip, from drive force and direction of travel. Plain floats.

Drive force and slip on a surface depend on the direction of travel far more than on anything else: three
wheels carry unequal loads on rollers that touch at changing places. So each known surface has two curves over
direction, force and slip. A measured force lies near the curve of one surface, between two, or near none: an
unknown surface.
"""

import math
import operator
from collections.abc import Sequence
from typing import Annotated, NamedTuple, Self

from pydantic import Field, model_validator

from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.travel_range import travel_problem
from drivers.settings import Settings

TOO_SLOW = "too slow to judge the surface"
TURNING = "turning: the map is one of straight travel"


class DirectionCurve(Settings):
    """A number over the direction of travel, and a little over speed.

    Attributes:
        mean: Its mean over all directions.
        cosines: Factors of cos(k direction), k = 1, 2, ...
        sines: Factors of sin(k direction).
        speed_slope: Change per m/s away from `speed_m_s`.
        speed_m_s: Mean speed of training.
    """

    mean: float
    cosines: tuple[float, ...]
    sines: tuple[float, ...]
    speed_slope: float = 0.0
    speed_m_s: float = 0.0

    def at(self, direction_rad: float, speed_m_s: float) -> float:
        """Return the number for a direction in the body frame and a speed."""
        total = self.mean + self.speed_slope * (speed_m_s - self.speed_m_s)
        for order, (cosine, sine) in enumerate(zip(self.cosines, self.sines, strict=True), start=1):
            total += cosine * math.cos(order * direction_rad) + sine * math.sin(order * direction_rad)
        return total


class SurfaceModel(Settings):
    """One known surface.

    Attributes:
        name: Its name in the training data.
        force_n: Drive force.
        slip: Slip ratio of the whole rover.
        drift_rad: Angle from the encoders' course to the true course, positive to the left.
        force_window_sd_n: Scatter of the force from one half second to the next.
        force_run_sd_n: Scatter of its mean from run to run: averaging does not reduce it.
        speed_range_m_s: Speeds of training; outside them the curves are held.
    """

    name: str
    force_n: DirectionCurve
    slip: DirectionCurve
    drift_rad: DirectionCurve
    force_window_sd_n: Annotated[float, Field(gt=0.0)]
    force_run_sd_n: Annotated[float, Field(ge=0.0)]
    speed_range_m_s: tuple[float, float]

    def held_speed_m_s(self, speed_m_s: float) -> float:
        """Return the nearest trained speed."""
        low, high = self.speed_range_m_s
        return max(low, min(high, speed_m_s))


class SurfaceMap(Settings):
    """All known surfaces, and the training range.

    Attributes:
        surfaces: At least one.
        directions_rad: Directions of training, in -pi to pi.
    """

    surfaces: Annotated[tuple[SurfaceModel, ...], Field(min_length=1)]
    directions_rad: Annotated[tuple[float, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        if len({surface.name for surface in self.surfaces}) < len(self.surfaces):
            raise ValueError("surfaces must have different names")
        return self

    def only(self, names: Sequence[str]) -> "SurfaceMap":
        """Return the map with the named surfaces alone, for a rover on known ground."""
        surfaces = tuple(surface for surface in self.surfaces if surface.name in names)
        return SurfaceMap(surfaces=surfaces, directions_rad=self.directions_rad)

    def range_problem(self, direction_rad: float, speed_m_s: float) -> str:
        """Return why the map does not hold for this travel; empty where it does."""
        low = min(surface.speed_range_m_s[0] for surface in self.surfaces)
        high = max(surface.speed_range_m_s[1] for surface in self.surfaces)
        return travel_problem(self.directions_rad, (low, high), direction_rad, speed_m_s)


class SurfaceEstimate(NamedTuple):
    """Surface and slip by the drive force.

    Attributes:
        slip: Slip ratio of the whole rover; every wheel takes it.
        drift_rad: Angle from the encoders' course to the true course, positive to the left.
        valid: False outside the training range and on an unknown surface.
        surface: The likeliest surface, or None where it is unknown.
        reason: Why the slip is not valid; empty where it is.
    """

    slip: float
    drift_rad: float
    valid: bool
    surface: str | None
    reason: str


class Travel(NamedTuple):
    """Motion and work of the wheels.

    Attributes:
        elapsed_s: Duration.
        x_m, y_m, yaw_rad: Motion of the body by the encoders, in the body frame.
        work_j: Work of the wheels: torque times angle, summed.
    """

    elapsed_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    work_j: float


class ForceWindow(NamedTuple):
    """Drive force over half a second.

    Attributes:
        direction_rad: Direction of travel in the body frame.
        speed_m_s: By the wheels.
        force_n: Work of the wheels per distance.
        problem: Why the force says nothing about the ground; empty where it does.
    """

    direction_rad: float
    speed_m_s: float
    force_n: float
    problem: str


NO_TRAVEL = Travel(0.0, 0.0, 0.0, 0.0, 0.0)


class _Node(NamedTuple):
    """One surface at a direction and a speed; sorted by force."""

    force_n: float
    sd_n: float
    slip: float
    drift_rad: float
    name: str


class SurfaceTracker:
    """Follows the drive force and estimates surface and slip.

    Args:
        surface_map: The known surfaces.
        base_radius_m: Distance of the wheels from the middle.

    Attributes:
        window: The newest half second; None before the first.
    """

    def __init__(self, surface_map: SurfaceMap, base_radius_m: float) -> None:
        self.window: ForceWindow | None = None
        self._map = surface_map
        self._base_radius_m = base_radius_m
        self._sd_n = max(surface.force_window_sd_n for surface in surface_map.surfaces)
        self._pending = NO_TRAVEL
        self._excess_n: float | None = None
        self._averaged_s = 0.0
        self._estimate = SurfaceEstimate(self.prior_slip, 0.0, False, None, "too little way so far")

    def step(self, travel: Travel) -> SurfaceEstimate:
        """Take the travel since the step before; a new estimate comes about every half second."""
        self._pending = Travel(*(a + b for a, b in zip(self._pending, travel, strict=True)))
        if self._pending.elapsed_s >= EFFORT.surface.window_s:
            self.window = self.force_window(self._pending)
            self._estimate = self._evaluate(self.window, self._pending.elapsed_s)
            self._pending = NO_TRAVEL
        return self._estimate

    def interrupt(self) -> None:
        """Forget the travel of the open window: part of it is unknown."""
        self._pending = NO_TRAVEL

    @property
    def prior_slip(self) -> float:
        """Mean slip of the known surfaces."""
        slips = [surface.slip.mean for surface in self._map.surfaces]
        return sum(slips) / len(slips)

    def force_window(self, travel: Travel) -> ForceWindow:
        """Return the drive force of a travel, and whether it says anything about the ground."""
        distance_m = math.hypot(travel.x_m, travel.y_m)
        speed_m_s = distance_m / travel.elapsed_s
        low_m_s = min(surface.speed_range_m_s[0] for surface in self._map.surfaces)
        if speed_m_s < 0.5 * low_m_s:
            return ForceWindow(0.0, speed_m_s, 0.0, TOO_SLOW)
        direction_rad = math.atan2(travel.y_m, travel.x_m)
        problem = self._map.range_problem(direction_rad, speed_m_s)
        if abs(travel.yaw_rad) * self._base_radius_m > EFFORT.surface.turning_share * distance_m:
            problem = TURNING
        return ForceWindow(direction_rad, speed_m_s, travel.work_j / distance_m, problem)

    def _evaluate(self, window: ForceWindow, elapsed_s: float) -> SurfaceEstimate:
        direction_rad, speed_m_s, problem = window.direction_rad, window.speed_m_s, window.problem
        if problem == TOO_SLOW:
            self._excess_n = None
            return self._estimate._replace(valid=False, reason=TOO_SLOW)
        force_n = self._averaged(window.force_n, direction_rad, speed_m_s, elapsed_s)
        estimate = self._classify(force_n, direction_rad, speed_m_s)
        return estimate._replace(valid=False, reason=problem) if problem else estimate

    def _averaged(self, force_n: float, direction_rad: float, speed_m_s: float, elapsed_s: float) -> float:
        # Averages the force above the mean of the known surfaces in this direction, so that a curve does not
        # smear the average. A jump means another surface: forget the old one at once.
        surfaces = self._map.surfaces
        forces_n = [s.force_n.at(direction_rad, s.held_speed_m_s(speed_m_s)) for s in surfaces]
        common_n = sum(forces_n) / len(forces_n)
        excess_n = force_n - common_n
        greatest_n = EFFORT.surface.unknown_deviations * self._sd_n
        if self._excess_n is None or abs(excess_n - self._excess_n) > greatest_n:
            self._excess_n, self._averaged_s = excess_n, elapsed_s
        else:
            self._averaged_s = min(self._averaged_s, EFFORT.surface.memory_s) + elapsed_s
            self._excess_n += elapsed_s / self._averaged_s * (excess_n - self._excess_n)
        return common_n + self._excess_n

    def _classify(self, force_n: float, direction_rad: float, speed_m_s: float) -> SurfaceEstimate:
        """Weigh the surfaces by how well the force fits; between two of them, interpolate."""
        nodes: list[_Node] = []
        window_s = EFFORT.surface.window_s
        for surface in self._map.surfaces:
            held_m_s = surface.held_speed_m_s(speed_m_s)
            variance = surface.force_window_sd_n**2 * window_s / max(self._averaged_s, window_s)
            nodes.append(
                _Node(
                    force_n=surface.force_n.at(direction_rad, held_m_s),
                    sd_n=math.sqrt(variance + surface.force_run_sd_n**2),
                    slip=surface.slip.at(direction_rad, held_m_s),
                    drift_rad=surface.drift_rad.at(direction_rad, held_m_s),
                    name=surface.name,
                )
            )
        nodes.sort()
        forces = [node.force_n for node in nodes]
        weights = [math.exp(-0.5 * ((force_n - node.force_n) / node.sd_n) ** 2) / node.sd_n for node in nodes]
        mean_sd_n = sum(node.sd_n for node in nodes) / len(nodes)
        between_weight = math.exp(-0.5 * EFFORT.surface.unknown_deviations**2) / mean_sd_n
        blended = [
            (sum(map(operator.mul, weights, values)) + between_weight * _between(forces, values, force_n))
            / (sum(weights) + between_weight)
            for values in ([node.slip for node in nodes], [node.drift_rad for node in nodes])
        ]
        slip, drift_rad = max(-1.0, min(1.0, blended[0])), blended[1]
        if sum(weights) < between_weight:
            reason = f"unknown surface: drive force {force_n:.1f} N"
            return SurfaceEstimate(slip, drift_rad, False, None, reason)
        best = max(range(len(nodes)), key=weights.__getitem__)
        return SurfaceEstimate(slip, drift_rad, True, nodes[best].name, "")


def _between(points: Sequence[float], values: Sequence[float], at: float) -> float:
    """Return the value at a place between sorted points that may coincide; constant outside the ends."""
    for index in range(1, len(points)):
        if at <= points[index]:
            width = points[index] - points[index - 1]
            share = max(0.0, (at - points[index - 1]) / width) if width > 0.0 else 0.5
            return values[index - 1] + share * (values[index] - values[index - 1])
    return values[-1]
