"""Forces on a wheel by adaptive quadrature, integral by integral: the usual research code, written plainly.

A peer for `benchmarks.terrain.kernel` and a reference for tests. It follows equations 10 to 28 of the paper
on slope traversability with their misprints corrected, and shares nothing with the kernels but the data.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from sim_backends.terramechanics.soil.library import ReeceLaw, SoilSettings, WheelSettings


@dataclass(frozen=True)
class AdaptiveWheel:
    """A wheel on a soil of Reece's law, in slip.

    Attributes:
        camber_rad: gamma, at least 0.
        cross_slope_rad: alpha.
        tolerance: Relative, of each integral.
    """

    wheel: WheelSettings
    soil: SoilSettings
    camber_rad: float = 0.0
    cross_slope_rad: float = 0.0
    gravity_m_s2: float = 9.80665
    tolerance: float = 1e-10

    def forces(self, sinkage_m: float, slip: float, slip_angle_rad: float) -> tuple[float, ...]:
        """Return drawbar pull, side force, vertical force and torque."""
        width, tilt = self.wheel.width_m, math.tan(self.camber_rad)
        if tilt == 0.0:
            total = [width * part for part in self._slice(sinkage_m, sinkage_m, slip, slip_angle_rad)]
        else:
            start = max(-0.5 * width, -sinkage_m / tilt)
            total = [
                quad(
                    lambda y, part=part: self._slice(
                        sinkage_m, sinkage_m + y * tilt, slip, slip_angle_rad, part
                    )[part],
                    start,
                    0.5 * width,
                    epsrel=self.tolerance,
                    epsabs=0.0,
                    limit=200,
                )[0]
                for part in range(4)
            ]
        total[1] += self._sidewall(sinkage_m, slip_angle_rad)
        return tuple(total)

    def _slice(
        self, sinkage_m: float, depth_m: float, slip: float, slip_angle_rad: float, only: int | None = None
    ) -> list[float]:
        """Return the integrals of eqs 10 to 12, and of the torque, per width."""
        radius = self.wheel.radius_m
        share = self._exit_share(slip)
        entry, leaving = math.acos(1 - depth_m / radius), -math.acos(1 - share * depth_m / radius)
        greatest = (self.soil.greatest_stress[0] + self.soil.greatest_stress[1] * slip) * entry
        stresses = self._stresses(sinkage_m, entry, leaving, greatest, slip, slip_angle_rad)

        def integrand(theta: float, part: int) -> float:
            normal, along, across = stresses(theta)
            return (
                along * math.cos(theta) - normal * math.sin(theta),
                across,
                along * math.sin(theta) + normal * math.cos(theta),
                radius * along,
            )[part]

        result = [0.0] * 4
        for part in range(4) if only is None else (only,):
            result[part] = radius * sum(
                quad(integrand, low, high, args=(part,), epsrel=self.tolerance, epsabs=0.0, limit=200)[0]
                for low, high in ((leaving, 0.0), (0.0, greatest), (greatest, entry))
                if high > low
            )
        return result

    def _stresses(
        self,
        sinkage_m: float,
        entry: float,
        leaving: float,
        greatest: float,
        slip: float,
        slip_angle_rad: float,
    ) -> Callable[[float], tuple[float, float, float]]:
        soil, radius = self.soil, self.wheel.radius_m
        law = soil.pressure
        assert isinstance(law, ReeceLaw)
        size = self._contact_size(sinkage_m, slip)
        bearing = soil.cohesion_pa * law.k_c + soil.density_kg_m3 * self.gravity_m_s2 * size * law.k_phi
        side = (1 - slip) * math.tan(slip_angle_rad)

        def stresses(theta: float) -> tuple[float, float, float]:
            front = theta
            if theta < greatest:
                front = entry - (theta - leaving) * (entry - greatest) / (greatest - leaving)
            depth = max(math.cos(front) - math.cos(entry), 0.0) * radius / size
            normal = bearing * depth**law.exponent
            along = (entry - theta) - (1 - slip) * (math.sin(entry) - math.sin(theta))
            moved = radius * math.hypot(along, side * (entry - theta))
            shear = (soil.cohesion_pa + normal * math.tan(soil.friction_angle_rad)) * (
                1 - math.exp(-moved / soil.shear_modulus_m)
            )
            forward = 1 - (1 - slip) * math.cos(theta)
            speed = math.hypot(forward, side)
            if speed == 0.0:
                return normal, 0.0, 0.0
            return normal, shear * forward / speed, -shear * side / speed

        return stresses

    def _exit_share(self, slip: float) -> float:
        return sum(factor * slip**power for power, factor in enumerate(self.soil.exit_polynomial))

    def _contact_size(self, sinkage_m: float, slip: float) -> float:
        """Return l_w, from the deeper edge."""
        radius, width, tilt = self.wheel.radius_m, self.wheel.width_m, math.tan(self.camber_rad)
        deepest = sinkage_m + 0.5 * width * tilt
        length = radius * (
            math.sin(math.acos(1 - deepest / radius))
            + math.sin(math.acos(1 - self._exit_share(slip) * deepest / radius))
        )
        return min(length, width if tilt == 0.0 else min(sinkage_m / tilt + 0.5 * width, width))

    def _sidewall(self, sinkage_m: float, slip_angle_rad: float) -> float:
        """Return F_ys of eq 31 for a soil without cohesion and wall friction."""
        if slip_angle_rad == 0.0:
            return 0.0
        half = 0.5 * self.wheel.width_m * math.tan(self.camber_rad)
        lean, slope = self.camber_rad - self.cross_slope_rad, self.cross_slope_rad
        right, left = self._wall_integral(sinkage_m - half), self._wall_integral(sinkage_m + half)
        if slip_angle_rad < 0.0:
            force = self._passive(lean, -slope) * right - self._active(-lean, slope) * left
        else:
            force = self._passive(-lean, slope) * left - self._active(lean, -slope) * right
        return -force * math.sin(slip_angle_rad)

    def _wall_integral(self, depth_m: float) -> float:
        """Return eq 27 for P = rho g h^2."""
        if depth_m <= 0.0:
            return 0.0
        radius = self.wheel.radius_m
        entry = math.acos(1 - depth_m / radius)
        weight = self.soil.density_kg_m3 * self.gravity_m_s2

        def integrand(theta: float) -> float:
            height = radius * (math.cos(theta) - math.cos(entry))
            return weight * height**2 * (radius - height * math.cos(theta))

        return float(quad(integrand, -entry, entry, epsrel=self.tolerance, epsabs=0.0)[0])

    def _passive(self, lean: float, slope: float) -> float:
        phi = self.soil.friction_angle_rad

        def factor(mu: float) -> float:
            scale = math.cos(lean) * (math.sin(lean) + math.cos(lean) / math.tan(mu + phi))
            top = math.cos(mu - lean) * math.cos(lean - slope)
            heap = math.cos(mu - lean) * math.sin(phi + slope) / (math.cos(lean + phi) * math.sin(mu - slope))
            return top * (1 + heap) / (2 * scale * math.sin(mu - slope) * math.cos(lean))

        return _minimum(factor, slope, math.pi / 2 + lean - phi)

    def _active(self, lean: float, slope: float) -> float:
        phi = self.soil.friction_angle_rad

        def factor(mu: float) -> float:
            scale = math.cos(lean) * (math.sin(lean) + math.cos(lean) / math.tan(mu - phi))
            top = math.cos(mu - lean) * math.cos(lean - slope)
            return -top / (2 * scale * math.sin(mu - slope) * math.cos(lean))

        return -_minimum(factor, phi, math.pi / 2 + lean)


def _minimum(factor: Callable[[float], float], low: float, high: float) -> float:
    edge = 1e-6 * (high - low)
    inside = (low + edge, high - edge)
    minimum = minimize_scalar(factor, bounds=inside, method="bounded", options={"xatol": 1e-11})
    return float(minimum.fun)
