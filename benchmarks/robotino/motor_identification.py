"""How well motors are identified: errors and honest intervals on simulated logs, misfit on measured ones.

    python -m benchmarks.robotino.motor_identification [SEEDS]

simulates `SEEDS` motors (100) twice through the measured staircase of setpoints, with the measured noise: as
the board drives a free motor, and with a soft speed loop, a third of a rover as inertia and the voltage
measured. Prints JSON: for each parameter bias and rms error as a share of the truth, half of the interval,
and how often the interval covers the truth; then the misfit of fit and data sheet on the measured records.
Exit code 1 when a bias is above 5 % or a coverage is outside 90 to 100 %.
"""

import json
import sys
from pathlib import Path

import numpy as np

from rover_hil.identify.motor.fit import LOOP_PERIOD_S
from rover_hil.identify.motor.record import MotorSignals, cut_set_point
from rover_hil.identify.motor.report import MotorReport, report_motor
from rover_hil.identify.motor.robotino import SCALE, read_table
from rover_hil.report.tracks import Series
from tests.nature.motor import Measured, TrueMotor, measure, staircase

SPEEDS_RAD_S = (25.0, 50.0, 75.0, 100.0, 125.0, 150.0, 175.0)
BIAS_BAR = 0.05
COVERAGE_BAR = 0.90
RECORDS = Path(__file__).resolve().parents[3] / "shared/data/robotino_2023/motor_identification"
CASES = {
    "free motor, no voltage": (TrueMotor(), False),
    "soft loop, rover's inertia, voltage": (TrueMotor(kp=20, inertia_kg_m2=4.1e-5), True),
}


def truth(motor: TrueMotor) -> dict[str, float]:
    """Return what the identification should find."""
    stiff = motor.speed_constant_v_s + motor.stiffness_v_s
    kt = motor.torque_constant_nm_a
    droop, viscous = motor.resistance_ohm / stiff, motor.viscous_nm_s / kt
    inertia = motor.inertia_kg_m2 / kt
    return {
        "coulomb_a": motor.coulomb_nm / kt,
        "viscous_a_s_per_rad": viscous,
        "inertia_a_s2_per_rad": inertia,
        # A setpoint waits for half a cycle of the board on average.
        "delay_s": motor.delay_s + LOOP_PERIOD_S / 2,
        "lag_s": inertia * droop / (1 + droop * viscous),
        "gain": (motor.feed_forward_v_s + motor.stiffness_v_s) / stiff,
        "droop_rad_s_per_a": droop,
        "resistance_ohm": motor.resistance_ohm,
        "speed_constant_v_s_per_rad": motor.speed_constant_v_s,
        "torque_constant_nm_per_a": kt,
    }


def record(measured: Measured, motor: int, *, voltage: bool) -> MotorSignals:
    """Return one of the simulated motors as the identification reads it."""
    t_s = measured.t_s
    return MotorSignals(
        log="simulated",
        motor=motor + 1,
        is_robotino=True,
        set_point=Series(t_s, cut_set_point(measured.set_point_rad_s, SCALE.speed_rad_s)),
        position=Series(t_s, measured.ticks[:, motor] * SCALE.position_rad),
        speed=Series(t_s, measured.speed_rad_s[:, motor]),
        current=Series(t_s, measured.current_a[:, motor]),
        current_is_signed=False,
        voltage=Series(t_s, measured.voltage_v[:, motor]) if voltage else None,
        scale=SCALE,
    )


def scores(reports: list[MotorReport], true: dict[str, float]) -> dict[str, dict[str, float]]:
    """Return errors and coverage of every parameter that at least one report gives an interval for."""
    table: dict[str, dict[str, float]] = {}
    for name, value in true.items():
        given = [
            estimate
            for report in reports
            for estimate in report.estimates
            if estimate.name == name and estimate.low is not None and estimate.high is not None
        ]
        if not given:
            continue
        low = np.array([estimate.low for estimate in given], dtype=float)
        high = np.array([estimate.high for estimate in given], dtype=float)
        error = ((low + high) / 2 - value) / value
        table[name] = {
            "truth": value,
            "given": len(given),
            "determined": sum(estimate.determined for estimate in given),
            "bias": round(float(error.mean()), 4),
            "rms": round(float(np.sqrt(np.mean(error**2))), 4),
            "within_5_percent": round(float(np.mean(np.abs(error) <= 0.05)), 3),
            "half_interval": round(float(np.median(high - low) / 2 / value), 4),
            "coverage": round(float(np.mean((low <= value) & (value <= high))), 3),
        }
    return table


def measured_misfit() -> dict[str, list[dict[str, float]]]:
    """Return the misfit of fit and data sheet for each motor of the measured records, if they are there."""
    misfits = {}
    for path in sorted(RECORDS.glob("*.csv.gz")) if RECORDS.is_dir() else ():
        reports = [report_motor([item]) for item in read_table(path)]
        misfits[path.name] = [
            {
                "fit_speed_rad_s": round(report.fitted.speed_rad_s, 2),
                "sheet_speed_rad_s": round(report.data_sheet.speed_rad_s, 2),
                "fit_current_a": round(report.fitted.current_a, 4),
                "sheet_current_a": round(report.data_sheet.current_a, 4),
            }
            for report in reports
            if report.fitted is not None and report.data_sheet is not None
        ]
    return misfits


def main() -> int:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    results = {}
    for number, (name, (motor, voltage)) in enumerate(CASES.items()):
        rng = np.random.default_rng(number)
        measured = measure(motor, staircase(SPEEDS_RAD_S), seeds, rng, delay_spread_s=0.01)
        reports = [report_motor([record(measured, index, voltage=voltage)]) for index in range(seeds)]
        results[name] = scores(reports, truth(motor))
    passed = all(
        abs(row["bias"]) <= BIAS_BAR and row["coverage"] >= COVERAGE_BAR
        for table in results.values()
        for row in table.values()
    )
    print(json.dumps({"simulated": results, "measured": measured_misfit(), "passed": passed}, indent=2))
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
