"""The report on a motor: each parameter, its interval, and whether the data determine it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.errors import LogError
from rover_hil.drives.arrays import rms
from rover_hil.identify.motor.fit import ELECTRIC_LAG_S, HIDDEN, MotorFit, fit_motor
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.problem import MotorProblem
from rover_hil.identify.motor.record import MotorSignals
from rover_hil.identify.motor.response import MotorModel
from rover_hil.identify.motor.sensitivity import lost_combinations
from rover_hil.identify.motor.uncertainty import Uncertainty, assess

KT_SHEET_NM_A = 0.0514

UNITS = {
    "coulomb_a": "A",
    "viscous_a_s_per_rad": "A s/rad",
    "inertia_a_s2_per_rad": "A s2/rad",
    "delay_s": "s",
    "lag_s": "s",
    "gain": "-",
    "droop_rad_s_per_a": "rad/s/A",
    "resistance_ohm": "ohm",
    "speed_constant_v_s_per_rad": "V s/rad",
    "torque_constant_nm_per_a": "N m/A",
    "coulomb_nm": "N m",
    "viscous_nm_s_per_rad": "N m s/rad",
    "inertia_kg_m2": "kg m2",
}
DATA_SHEET = {
    "coulomb_a": 0.2,
    "inertia_a_s2_per_rad": 7.1e-6 / KT_SHEET_NM_A,
    "delay_s": 0.1006,
    "gain": 1.0,
    "resistance_ohm": 5.95,
    "speed_constant_v_s_per_rad": 0.0514,
    "torque_constant_nm_per_a": KT_SHEET_NM_A,
    "inertia_kg_m2": 7.1e-6,
}
"""Dunkermotoren GR 42x25 (Ra, Ke, Kt, rotor inertia, no-load current); the delay is the one that
BrOleg5/Slippage-compensation identified. The data sheet knows neither loads nor the speed loop."""
TORQUES = {
    "coulomb_nm": "coulomb_a",
    "viscous_nm_s_per_rad": "viscous_a_s_per_rad",
    "inertia_kg_m2": "inertia_a_s2_per_rad",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """One parameter; the value is None where the data do not determine it."""

    name: str
    unit: str
    value: float | None
    low: float | None
    high: float | None
    data_sheet: float | None
    determined: bool
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Misfit:
    """Root mean square of measured minus predicted."""

    speed_rad_s: float
    current_a: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorReport:
    """All about one motor.

    Attributes:
        motor: Its number, from 1.
        estimates: Every parameter.
        fitted, data_sheet: Misfit of the fitted model and of the data-sheet values, at the mean delay.
        undetermined: Combinations of physical constants that change nothing that was measured.
        notes: What else to know.
        speed_range_rad_s, current_range_a: What the logs cover.
    """

    motor: int
    estimates: tuple[Estimate, ...]
    fitted: Misfit | None
    data_sheet: Misfit | None
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    speed_range_rad_s: tuple[float, float]
    current_range_a: tuple[float, float]


def report_motor(records: Sequence[MotorSignals]) -> MotorReport:
    """Identify one motor from all its logs.

    Raises:
        LogError: The logs come from different devices.
    """
    if len({(record.is_robotino, record.scale) for record in records}) > 1:
        raise LogError(
            f"motor {records[0].motor}: the logs come from different drives: identify them one by one"
        )
    problem = MotorProblem(records)
    nothing = _nothing_to_learn(problem)
    if nothing:
        return _empty(records[0].motor, problem, nothing)
    fit = fit_motor(problem)
    uncertainty = assess(problem, fit)
    estimates = _estimates(problem, fit, uncertainty)
    is_robotino = records[0].is_robotino
    return MotorReport(
        motor=records[0].motor,
        estimates=_of_drive(problem, estimates),
        fitted=_misfit(problem, fit.model, uncertainty.delay_s),
        data_sheet=_misfit(problem, _data_sheet_model(), DATA_SHEET["delay_s"]) if is_robotino else None,
        undetermined=lost_combinations(fit),
        notes=_notes(problem, estimates, uncertainty),
        speed_range_rad_s=_speed_range(problem),
        current_range_a=_current_range(problem),
    )


def _nothing_to_learn(problem: MotorProblem) -> str:
    records = [part.record for part in problem.parts]
    if not any(record.set_point.value.any() for record in records):
        return "its setpoint is always 0"
    if _speed_range(problem)[1] < MOTOR_FIT.record.turned_rad_s:
        return "it never turned"
    if not any(record.current.value.any() for record in records):
        return "its current always reads 0"
    readings = np.concatenate([np.abs(record.current.value) for record in records])
    saturated = np.mean(readings >= _ceiling(readings, records[0].scale.current_limit_a))
    if saturated > MOTOR_FIT.record.saturated_share:
        return f"its current is saturated at {readings.max():.2f} A in {saturated:.0%} of the samples"
    changes = sum(part.moves.t_s.size - 1 for part in problem.parts)
    starts = sum(abs(part.first_speed) < MOTOR_FIT.record.turned_rad_s for part in problem.parts)
    if changes == 0 and starts == 0:
        return "its setpoint never changes"
    return ""


def _ceiling(readings: np.ndarray, limit_a: float) -> float:
    """Return the reading at which the sensor is at its end: known, or where readings pile up."""
    values, counts = np.unique(readings, return_counts=True)
    if values.size > 2 and counts[-1] >= 5 and counts[-1] > 3 * counts[-2]:
        return float(min(limit_a, values[-1]))
    return limit_a


def _estimates(problem: MotorProblem, fit: MotorFit, uncertainty: Uncertainty) -> list[Estimate]:
    half = dict(zip(fit.names, uncertainty.half_widths().tolist(), strict=True))
    value = {name: float(getattr(fit.model, name)) for name in fit.names}
    value["delay_s"], half["delay_s"] = uncertainty.delay_s, uncertainty.delay_half_s
    if "speed_constant_v_s_per_rad" in value:
        for kind in (value, half):
            kind["torque_constant_nm_per_a"] = kind["speed_constant_v_s_per_rad"]
    why = _reasons(problem, fit, uncertainty)
    estimates = [
        estimate(name, value.get(name), half.get(name, np.inf), why(name))
        for name in UNITS
        if name not in TORQUES
    ]
    by_name = {item.name: item for item in estimates}
    torque = by_name["torque_constant_nm_per_a"]
    for name, source in TORQUES.items():
        estimates.append(_in_torque(name, by_name[source], torque))
    return estimates


def estimate(name: str, value: float | None, half: float, why: str) -> Estimate:
    """Return the estimate of a parameter whose interval is `half` wide to either side.

    Args:
        name: A key of `UNITS`.
        value: None where there is none.
        half: Half of the 95 % interval.
        why: Why it is not determined, if it is not.
    """
    determined = value is not None and bool(half <= MOTOR_FIT.report.relative_half * abs(value))
    has_interval = value is not None and np.isfinite(half)
    if determined and name == "torque_constant_nm_per_a":
        why = "equals Ke in SI units"
    elif determined:
        why = ""
    return Estimate(
        name=name,
        unit=UNITS[name],
        value=value if determined else None,
        low=float(value - half) if has_interval and value is not None else None,
        high=float(value + half) if has_interval and value is not None else None,
        data_sheet=DATA_SHEET.get(name),
        determined=determined,
        why=why,
    )


def _in_torque(name: str, source: Estimate, torque: Estimate) -> Estimate:
    held = not torque.determined
    kt = torque.value if torque.value is not None else KT_SHEET_NM_A
    kt_half = 0.0 if held or torque.high is None else torque.high - kt
    value = low = high = None
    if source.value is not None and source.high is not None:
        value = source.value * kt
        half = abs(value) * float(np.hypot((source.high - source.value) / source.value, kt_half / kt))
        low, high = value - half, value + half
    why = f"with Kt held at {KT_SHEET_NM_A:g} N m/A of the data sheet" if held else "with Kt = Ke"
    return Estimate(
        name=name,
        unit=UNITS[name],
        value=value,
        low=low,
        high=high,
        data_sheet=DATA_SHEET.get(name),
        determined=value is not None and not held,
        why=why if value is not None else source.why,
    )


def _reasons(problem: MotorProblem, fit: MotorFit, uncertainty: Uncertainty) -> Callable[[str], str]:
    speeds = {round(abs(value), 3) for part in problem.parts for value in part.moves.value.tolist()} - {0.0}
    names = list(fit.names)

    def why(name: str) -> str:
        if name in ("resistance_ohm", "speed_constant_v_s_per_rad") and not problem.has_voltage:
            return "no voltage was measured"
        if name == "torque_constant_nm_per_a":
            return "neither voltage nor torque was measured: only ratios to Kt"
        if name in HIDDEN and name not in names:
            return f"the speed settles between two samples ({problem.period_s * 1e3:.0f} ms apart)"
        if name == "delay_s":
            return "no change of the setpoint determines it"
        if len(speeds) == 1:
            return "one speed only: friction, gain and droop cannot be distinguished"
        partner = np.abs(uncertainty.correlation[names.index(name)]).copy()
        partner[names.index(name)] = 0.0
        most = int(partner.argmax())
        if partner[most] > 0.9:
            return f"confounded with {names[most]} (correlation {partner[most]:.2f})"
        return "the interval is wide: record more or longer logs, more speeds"

    return why


def _of_drive(problem: MotorProblem, estimates: Sequence[Estimate]) -> tuple[Estimate, ...]:
    """Return the estimates, without the data sheet where the motor is another one."""
    is_robotino = problem.parts[0].record.is_robotino
    return tuple(item if is_robotino else replace(item, data_sheet=None) for item in estimates)


def _data_sheet_model() -> MotorModel:
    return MotorModel(
        gain=1.0,
        lag_s=4 * ELECTRIC_LAG_S,
        coulomb_a=DATA_SHEET["coulomb_a"],
        inertia_a_s2_per_rad=DATA_SHEET["inertia_a_s2_per_rad"],
        electric_lag_s=ELECTRIC_LAG_S,
    )


def _misfit(problem: MotorProblem, model: MotorModel, delay_s: float) -> Misfit:
    delays_s = np.full(problem.moves, delay_s if np.isfinite(delay_s) else 0.0)
    items = problem.residuals(model, delays_s)
    speed = np.concatenate(
        [part.speed_residuals(item) for part, item in zip(problem.parts, items, strict=True)]
    )
    current = np.concatenate([item.current for item in items])
    return Misfit(speed_rad_s=rms(speed), current_a=rms(current))


def _notes(problem: MotorProblem, estimates: Sequence[Estimate], uncertainty: Uncertainty) -> tuple[str, ...]:
    notes = []
    friction_a = next((item.value for item in estimates if item.name == "coulomb_a"), None) or 0.0
    share = friction_a / DATA_SHEET["coulomb_a"]
    if problem.parts[0].record.is_robotino and share > MOTOR_FIT.report.loaded:
        notes.append(
            f"friction is {share:.1f} times the no-load current of the data sheet: "
            "on the ground it contains what rolling costs, and is not the motor's own"
        )
    if not all(part.uses_ticks for part in problem.parts):
        notes.append("positions contradict the reported speeds and are not used")
    if uncertainty.delay_spread_s > MOTOR_FIT.report.spread_periods * problem.period_s:
        notes.append(
            f"the loop delay differs from move to move by {uncertainty.delay_spread_s * 1e3:.0f} ms rms"
        )
    return tuple(notes)


def _empty(motor: int, problem: MotorProblem, why: str) -> MotorReport:
    estimates = [estimate(name, None, np.inf, why) for name in UNITS]
    return MotorReport(
        motor=motor,
        estimates=_of_drive(problem, estimates),
        fitted=None,
        data_sheet=None,
        undetermined=("everything",),
        notes=(),
        speed_range_rad_s=_speed_range(problem),
        current_range_a=_current_range(problem),
    )


def _speed_range(problem: MotorProblem) -> tuple[float, float]:
    speeds = np.concatenate([np.abs(part.motion_speed()[1]) for part in problem.parts])
    return float(speeds.min()), float(np.percentile(speeds, 99))


def _current_range(problem: MotorProblem) -> tuple[float, float]:
    currents = np.concatenate([part.record.current.value for part in problem.parts])
    return float(currents.min()), float(currents.max())
