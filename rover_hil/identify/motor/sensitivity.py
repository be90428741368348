"""Which physical constants the data cannot determine: the null space of the sensitivity matrix."""

import numpy as np

from rover_hil.drives.arrays import Array
from rover_hil.identify.motor.fit import MotorFit
from rover_hil.identify.motor.parameters import MOTOR_FIT

PHYSICAL = ("Ra", "Ke", "Kt", "inertia", "Coulomb torque", "viscous torque")
RATIOS = {
    "inertia": "inertia_a_s2_per_rad",
    "Coulomb torque": "coulomb_a",
    "viscous torque": "viscous_a_s_per_rad",
}


def sensitivity(fit: MotorFit) -> Array:
    """Return the change of the residuals per relative change of each physical constant.

    Friction and inertia enter as ratios to Kt. Where the voltage is measured Kt = Ke in SI units.
    """
    columns = dict(zip(fit.names, (fit.jacobian * _values(fit)).T, strict=True))
    nothing = np.zeros(fit.residual.size)
    physical = {name: columns.get(source, nothing) for name, source in RATIOS.items()}
    physical["Kt"] = -sum(physical.values(), start=nothing)
    physical["Ra"] = columns.get("resistance_ohm", nothing)
    physical["Ke"] = columns.get("speed_constant_v_s_per_rad", nothing)
    if "speed_constant_v_s_per_rad" in columns:
        physical["Ke"] = physical["Ke"] + physical["Kt"]
        physical["Kt"] = physical["Ke"]
    matrix = np.stack([physical[name] for name in PHYSICAL], axis=1)
    if "speed_constant_v_s_per_rad" in columns:
        matrix[:, PHYSICAL.index("Kt")] = 0.0
    return matrix


def lost_combinations(fit: MotorFit) -> tuple[str, ...]:
    """Return, in words, what can change without any change in what was measured."""
    matrix = sensitivity(fit)
    names = list(PHYSICAL)
    if "speed_constant_v_s_per_rad" in fit.names:
        matrix = np.delete(matrix, names.index("Kt"), axis=1)
        names.remove("Kt")
        names[names.index("Ke")] = "Ke = Kt"
    _, strength, directions = np.linalg.svd(matrix, full_matrices=False)
    null = directions[strength <= MOTOR_FIT.report.null_share * strength[0]]
    projection = null.T @ null
    alone = [
        index for index in range(len(names)) if projection[index, index] > 1 - MOTOR_FIT.report.lost_share
    ]
    shared = [
        index
        for index in range(len(names))
        if MOTOR_FIT.report.lost_share < projection[index, index] <= 1 - MOTOR_FIT.report.lost_share
    ]
    words = [f"{names[index]}: changes nothing that was measured" for index in alone]
    if shared:
        words.append(f"{', '.join(names[index] for index in shared)}: only their ratios are determined")
    return tuple(words)


def _values(fit: MotorFit) -> Array:
    return np.array([getattr(fit.model, name) for name in fit.names])
