"""Paper 001 once more: adaptive quadrature, a general solver, no code of the product.

Four wheels, cohesionless soil, no friction at the walls; the equations as corrected: exit angle negative,
walls with their own signs, F_s = F_sp - F_sa, l_c at the deepest edge.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad, quad_vec
from scipy.optimize import least_squares, minimize_scalar

Floats = NDArray[np.float64]
R, B = 0.097, 0.10
PHI, RHO, K_PHI, N = math.radians(38.0), 1.49e3, 122.73, 1.703
A0, A1, K = 0.40, 0.15, 0.0283
G = 9.80665
L_H, L_U, L_D = 0.187, 0.275, 0.275
SLICE, WEIGHT = np.polynomial.legendre.leggauss(40)


def bottom_forces(depth: float, slip: float, beta: float, roll: float) -> Floats:
    """Return F_x, F_y, F_z of the rim (eqs 10 to 24)."""
    lean = math.tan(roll)
    shallow = -0.5 * B if lean == 0.0 else max(-0.5 * B, -depth / lean)
    # Squares gather slices at the edge where the wheel leaves the soil.
    share = 0.5 * (SLICE + 1.0)
    y = shallow + (0.5 * B - shallow) * share**2
    weight = 0.5 * WEIGHT * 2.0 * share * (0.5 * B - shallow)
    ratio = 2.10 * slip**2 - 1.95 * slip + 0.82
    deep = depth + 0.5 * B * abs(lean)
    length = R * (math.sin(math.acos(1 - deep / R)) + math.sin(math.acos(1 - ratio * deep / R)))
    l_w = min(length, 0.5 * B - shallow)
    modulus = RHO * G * l_w * K_PHI * (R / l_w) ** N
    sinkage = depth + y * lean
    entry, leave = np.arccos(1 - sinkage / R), -np.arccos(1 - ratio * sinkage / R)
    most = (A0 + A1 * slip) * entry

    def stress(theta: Floats) -> Floats:
        front = np.where(theta >= most, theta, entry - (theta - leave) * (entry - most) / (most - leave))
        sigma = modulus * np.maximum(np.cos(front) - np.cos(entry), 0.0) ** N
        j_t = R * ((entry - theta) - (1 - slip) * (np.sin(entry) - np.sin(theta)))
        j_l = -R * (1 - slip) * (entry - theta) * math.tan(beta)
        v_t, v_l = 1 - (1 - slip) * np.cos(theta), -(1 - slip) * math.tan(beta)
        tau = sigma * math.tan(PHI) * (1 - np.exp(-np.hypot(j_t, j_l) / K)) / np.hypot(v_t, v_l)
        return np.stack(
            [
                tau * v_t * np.cos(theta) - sigma * np.sin(theta),
                tau * v_l,
                tau * v_t * np.sin(theta) + sigma * np.cos(theta),
            ]
        )

    total = np.zeros(3)
    for low, high in ((leave, np.zeros_like(entry)), (np.zeros_like(entry), most), (most, entry)):
        value, _ = quad_vec(
            lambda u, low=low, high=high: (high - low) * stress(low + (high - low) * u),
            0.0,
            1.0,
            epsabs=1e-7,
            epsrel=1e-11,
            norm="max",
        )
        total += R * np.sum(weight * value, axis=1)
    return total


def side_force(depth: float, beta: float, slope: float, roll: float) -> float:
    """Return F_y of the walls (eqs 25 to 31)."""
    if beta == 0.0:
        return 0.0
    way = -1.0 if beta < 0.0 else 1.0
    push = _wall(depth + way * 0.5 * B * math.tan(roll)) * _passive(way * (slope - roll), way * slope)
    pull = _wall(depth - way * 0.5 * B * math.tan(roll)) * _active(-way * (slope - roll), -way * slope)
    return -(push - pull) * math.sin(beta)


def _wall(depth: float) -> float:
    if depth <= 0.0:
        return 0.0
    entry = math.acos(1 - depth / R)

    def element(theta: float) -> float:
        height = R * (math.cos(theta) - math.cos(entry))
        return height**2 * (R - height * math.cos(theta))

    return RHO * G * float(quad(element, -entry, entry, epsabs=0.0, epsrel=1e-11)[0])


def _passive(lean: float, rise: float) -> float:
    def factor(mu: float) -> float:
        c = math.cos(mu - lean) * math.cos(lean - rise)
        c_p = math.cos(lean) * (math.sin(lean) + math.cos(lean) / math.tan(mu + PHI))
        heap = math.cos(mu - lean) * math.sin(PHI + rise) / (math.cos(lean + PHI) * math.sin(mu - rise))
        return c * (1 + heap) / (2 * c_p * math.sin(mu - rise) * math.cos(lean))

    return _least(factor, rise, 0.5 * math.pi + lean - PHI)


def _active(lean: float, rise: float) -> float:
    def factor(mu: float) -> float:
        c = math.cos(mu - lean) * math.cos(lean - rise)
        c_a = math.cos(lean) * (math.sin(lean) + math.cos(lean) / math.tan(mu - PHI))
        return -c / (2 * c_a * math.sin(mu - rise) * math.cos(lean))

    return -_least(factor, PHI, 0.5 * math.pi + lean)


def _least(factor: object, low: float, high: float) -> float:
    found = minimize_scalar(
        factor, bounds=(low + 1e-9, high - 1e-9), method="bounded", options={"xatol": 1e-9}
    )
    return float(found.fun)


def missing(unknown: Floats, slope: float, roll: float, mass: float) -> Floats:
    """Return what eqs 7 and 8 miss at slip, slip angle and both sinkages, in parts of the weight."""
    slip, beta = float(unknown[0]), float(unknown[1])
    weight = mass * G
    lever = L_H * math.tan(slope)
    loads = [weight * (arm - sign * lever) / (2 * (L_U + L_D)) for arm, sign in ((L_D, 1.0), (L_U, -1.0))]
    total, vertical = np.zeros(2), []
    for depth, load in zip(unknown[2:], loads, strict=True):
        forces = bottom_forces(float(depth), slip, beta, roll)
        total += 2.0 * forces[:2]
        total[1] += 2.0 * side_force(float(depth), beta, slope, roll)
        vertical.append(forces[2] - load * math.cos(slope - roll))
    total[1] -= weight * math.sin(slope - roll)
    return np.array([*total, *vertical]) / weight


def solve(slope_deg: float, roll_deg: float, mass_kg: float, start: Floats) -> Floats:
    """Return slip, slip angle (rad) and sinkages uphill and downhill of a traverse."""
    slope, roll = math.radians(slope_deg), math.radians(roll_deg)
    found = least_squares(
        missing,
        start,
        args=(slope, roll, mass_kg),
        x_scale=np.abs(start),
        xtol=1e-13,
        ftol=1e-15,
        gtol=1e-15,
        diff_step=1e-6,
    )
    assert np.max(np.abs(found.fun)) < 1e-9
    return np.asarray(found.x, dtype=np.float64)
