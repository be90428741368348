"""Residual of a rover's force balance at given slip, slip angle and sinkages; the searches bring it to zero.

The direction of the shear stress is singular where slip and sideways speed over the soil are both zero; near
that point forces grow like the square root of the distance. With s + i (1 - s) tan(beta) = (a + i b)^2 they
are smooth in a and b, so the search varies a and b. Where the soil itself moves, its speed is added to the
sideways speed.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim_backends.arrays import Array
from sim_backends.terramechanics.slope.load_transfer import Demand
from sim_backends.terramechanics.slope.rover import Conditions, Effects, SoilFlow
from sim_backends.terramechanics.soil.quadrature import Rule
from sim_backends.terramechanics.soil.wheel_contact import Kernel, WheelContact
from sim_backends.terramechanics.soil.wheel_forces import deepest_allowed, least_allowed
from sim_backends.terramechanics.soil.wheel_set import LEAST_SLIP, MOST_SLIP

SAME_LOAD = 1e-9
NO_SIDE = 1e-12


@dataclass(frozen=True)
class Balance:
    """A rover on a soil and its force balance.

    Wheels that bear the same load are computed once; `share` is the number of wheels of each kind. A point
    is an array of a, b and the sinkage of each kind at its middle plane.

    Attributes:
        contact: Wheel and soil.
        kernel: Computes the forces.
        conditions: Slope, roll and heading of the rover.
        effects: Effects beyond the model.
        demand: Forces that the soil must supply.
        load_n: F_z of each kind of wheel, (K,).
        share: Number of wheels of each kind, (K,).
    """

    contact: WheelContact
    kernel: Kernel
    conditions: Conditions
    effects: Effects
    demand: Demand
    load_n: Array
    share: Array

    @cached_property
    def straight(self) -> bool:
        """True when there is no side force, so that the slip angle is 0 for every slip."""
        return self.effects.soil_flow is None and abs(self.demand.left_n) < NO_SIDE * self.demand.weight_n

    @cached_property
    def depth_range(self) -> tuple[float, float]:
        """Least and greatest sinkage of the middle plane, m."""
        return least_allowed(self.contact), deepest_allowed(self.contact)

    @cached_property
    def side_origin(self) -> float:
        """Side speed at which the wheels, at slip 0 and an average sinkage, move with the soil."""
        if self.effects.soil_flow is None:
            return 0.0
        middling = np.full(self.load_n.size, 0.2 * self.contact.radius_m)
        return float(np.mean(self.effects.soil_flow(self.conditions, 0.0, middling)[1]))

    def motion(self, points: Array) -> tuple[Array, Array]:
        """Return slip ratio and side speed v_y / (r_s omega), (M,) each.

        Args:
            points: (M, 2 + K); negative a represents skid straight ahead.
        """
        a, b = points[:, 0], points[:, 1]
        slip = np.minimum(np.maximum(a * np.abs(a) - b * b, LEAST_SLIP), MOST_SLIP)
        return slip, self.side_origin + 2.0 * a * b

    def forces(self, rule: Rule, points: Array) -> Array:
        """Return drawbar pull, side force, vertical force and torque of each kind of wheel: (M, K, 4).

        Args:
            rule: Nodes.
            points: (M, 2 + K).
        """
        slip, side = self.motion(points)
        sinkage_m = points[:, 2:]
        states, kinds = sinkage_m.shape
        ratio, sides = slip.repeat(kinds), side.repeat(kinds)
        if self.effects.soil_flow is not None:
            along, across = self._flow(self.effects.soil_flow, slip, sinkage_m)
            speed = np.where(ratio >= 0.0, 1.0 - ratio, 1.0 / (1.0 + np.minimum(ratio, 0.0))) - along
            ratio, sides = _slip_of(np.maximum(speed, 1.0 - MOST_SLIP)), sides - across
        columns = self.kernel(self.contact, rule, sinkage_m.ravel(), ratio, sides)
        return np.asarray(columns.reshape(states, kinds, 4))

    def _flow(self, flow: SoilFlow, slip: Array, sinkage_m: Array) -> tuple[Array, Array]:
        kinds = sinkage_m.shape[1]
        flows = [flow(self.conditions, float(s), depth) for s, depth in zip(slip, sinkage_m, strict=True)]
        along = np.concatenate([np.broadcast_to(speeds[0], kinds) for speeds in flows])
        return along, np.concatenate([np.broadcast_to(speeds[1], kinds) for speeds in flows])

    def residual(self, forces: Array) -> Array:
        """Return the residuals relative to the weight and to the loads: (M, 2 + K).

        Args:
            forces: From `forces`.
        """
        total = self.share @ forces[:, :, :2]
        missing = np.empty((forces.shape[0], 2 + self.load_n.size))
        missing[:, 0] = (total[:, 0] - self.demand.forward_n) / self.demand.weight_n
        missing[:, 1] = (total[:, 1] - self.demand.left_n) / self.demand.weight_n
        missing[:, 2:] = forces[:, :, 2] / self.load_n - 1.0
        return missing

    def missing(self, rule: Rule, point: Array) -> Array:
        """Return the residuals at one point: (2 + K,).

        Args:
            rule: Nodes.
            point: (2 + K,).
        """
        if self.effects.soil_flow is not None:
            return np.asarray(self.residual(self.forces(rule, point[np.newaxis]))[0])
        # Most calls of a search are for one point; plain numbers are faster here than arrays.
        a, b = float(point[0]), float(point[1])
        slip = min(max(a * abs(a) - b * b, LEAST_SLIP), MOST_SLIP)
        kinds = self.load_n.size
        motion = np.full(kinds, slip), np.full(kinds, 2.0 * a * b)
        columns = self.kernel(self.contact, rule, point[2:], *motion)
        total = self.share @ columns[:, :2]
        missing = np.empty(2 + kinds)
        missing[0] = (total[0] - self.demand.forward_n) / self.demand.weight_n
        missing[1] = (total[1] - self.demand.left_n) / self.demand.weight_n
        missing[2:] = columns[:, 2] / self.load_n - 1.0
        return missing


def kinds_of_wheels(vertical_n: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return the different loads, how many wheels bear each, and the kind of each wheel.

    Args:
        vertical_n: F_z of each wheel, (N,).
    """
    size = float(np.abs(vertical_n).max())
    rounded = np.round(vertical_n / (size * SAME_LOAD))
    _, first, kind, count = np.unique(rounded, return_index=True, return_inverse=True, return_counts=True)
    return vertical_n[first], count.astype(np.float64), kind


def _slip_of(speed: Array) -> Array:
    return np.asarray(np.where(speed <= 1.0, 1.0 - speed, 1.0 / np.maximum(speed, 1.0) - 1.0))
