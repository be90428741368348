"""How much an identification changes when each of its tuned numbers is varied by 20 %.

    python -m benchmarks.identify.parameter_sensitivity [--of motor,slip,scomp,gyro] [--groups window,surface]
        [--data ../shared/data/robotino_2023]

Varies each number of `parameters.py` in `rover_hil/identify/motor`, `slip`, `scomp` and
`gyro` to 0.8 and 1.2 of its
value (whole numbers change by at least 1) and prints as Markdown the changes of a few figures; "refused"
where the identification rejects the data then. Numbers that change no figure are listed below the table.

- motor: both simulated motors of `benchmarks/robotino/motor_identification.py`, a short staircase, one seed.
- slip: every fifth measured run of the data set, and a simulated drive with pose fixes and a yaw excitation,
  whose slip is twice its transmission loss. Without the data set, the drive only.
- scomp: the first simulated field test of `benchmarks/four_wheels/scomp.py`, one seed.
- gyro: a virtual run of `rover-hil calibrate imu` with the Robotino.

About ten minutes on one core.
"""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.four_wheels.scomp import FIRST_SEED, TESTS, read
from benchmarks.robotino.motor_identification import CASES, record, truth
from benchmarks.sensitivity import print_table
from controllers.motion.kinematics import OmniKinematics
from controllers.slip.effort.motor_model import MotorSettings
from drivers.errors import LogError, ModelError
from rover_hil.datasets.robotino_csv import ROBOTINO
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.record import MotorRecord
from rover_hil.identify.motor.report import report_motor
from rover_hil.identify.scomp.fit import identify
from rover_hil.identify.scomp.parameters import SCOMP_FIT
from rover_hil.identify.slip.identification import identify_slip_maps, read_all
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import MeasuredRun
from rover_hil.identify.slip.runs import find_runs
from rover_hil.identify.slip.scores import Score
from rover_hil.identify.slip.windows import form_windows
from rover_hil.ready.imu.calibration import GyroCalibration
from rover_hil.ready.imu.fit import fit_response
from rover_hil.ready.imu.parameters import GYRO_FIT
from rover_hil.ready.imu.turns import read_turns
from rover_hil.ready.procedure import Request, run
from tests.nature.four_wheel_drive import Recorded, field_test
from tests.nature.motor import measure, staircase

DATA = Path(__file__).resolve().parents[3] / "shared/data/robotino_2023"
EVERY = 5
FIX_SD_M = 0.0025  # of the simulated drive
LOSSES = (0.0, 0.1, 0.2, 0.3, 0.4)
STRETCH_S = 24.0
SPEED_M_S = 0.15
PROMISES = ("surface.least_runs",)
"""A number that documents promise."""

Figures = Mapping[str, float]


def motor_records() -> dict[str, tuple[MotorRecord, dict[str, float]]]:
    """Return one record of each simulated motor with its true parameters."""
    found = {}
    for number, (name, (motor, has_voltage)) in enumerate(CASES.items()):
        rng = np.random.default_rng(number)
        measured = measure(motor, staircase((50.0, 100.0, 150.0)), 1, rng, delay_spread_s=0.01)
        found[name] = (record(measured, 0, voltage=has_voltage), truth(motor))
    return found


def motor_figures(records: Mapping[str, tuple[MotorRecord, dict[str, float]]]) -> Figures:
    """Return for each motor the rms error and the rms half interval of the parameters with an interval."""
    figures = {}
    for (item, true), label in zip(records.values(), ("free", "loaded"), strict=True):
        report = report_motor([item])
        errors, halves = [], []
        for one in report.estimates:
            if one.value is not None and one.low is not None and one.high is not None and one.name in true:
                errors.append(one.value / true[one.name] - 1.0)
                halves.append(0.5 * (one.high - one.low) / true[one.name])
        figures[f"{label}: error, %"] = 100.0 * math.sqrt(float(np.mean(np.square(errors))))
        figures[f"{label}: half interval, %"] = 100.0 * math.sqrt(float(np.mean(np.square(halves))))
        figures[f"{label}: determined"] = float(sum(one.determined for one in report.estimates))
        figures[f"{label}: notes"] = float(len(report.notes) + len(report.undetermined))
    return figures


def shaken_drive(seed: int) -> MeasuredRun:
    """Return a drive to the left with yaw excitation; each stretch has another transmission loss."""
    rng, period_s = np.random.default_rng(seed), 0.02
    t_s = np.asarray(period_s * np.arange(1, round(len(LOSSES) * STRETCH_S / period_s)), np.float64)
    lost = np.array(LOSSES)[(t_s / STRETCH_S).astype(int)] + 0.01 * rng.normal(size=t_s.size)
    rates = 0.5 * np.sin(math.tau * 5.0 * t_s)
    kinematics = OmniKinematics(ROBOTINO)
    speeds = np.array([kinematics.wheel_speeds(0.0, SPEED_M_S, rate) for rate in rates.tolist()])
    yaw_rad = np.cumsum((1.0 - lost) * rates) * period_s
    place = np.cumsum(1j * SPEED_M_S * (1.0 - 2.0 * lost) * np.exp(1j * yaw_rad)) * period_s
    fixes = rng.normal(scale=FIX_SD_M, size=(t_s.size, 2))
    poses = np.column_stack((place.real + fixes[:, 0], place.imag + fixes[:, 1], yaw_rad))[::5]
    return MeasuredRun(
        path=Path("shaken"),
        surface="",
        t_s=t_s,
        position_rad=np.cumsum(speeds, axis=0) * period_s,
        current_a=np.full((t_s.size, 3), 0.5),
        current_is_signed=False,
        set_speed_rad_s=speeds,
        camera_t_s=t_s[::5],
        camera=poses,
        camera_in_pixels=False,
        gyro=np.column_stack((t_s, (1.0 - lost) * rates)),
        fix_sd_m=np.full(len(poses), FIX_SD_M),
    )


def slip_figures(files: Sequence[Path], shaken: MeasuredRun) -> Figures:
    """Return scale and cross-validated errors of the measured runs, and windows of the drive with fixes."""
    figures: dict[str, float] = {}
    if files:
        found = identify_slip_maps(read_all(files, MotorSettings(), lambda: None), lambda: None)
        figures["scale, mm/px"] = found.scale.mm_per_px or math.nan
        figures["is a scale error"] = float(bool(found.scale.is_scale_error))
        for name in ("isotonic_m", "best"):
            score = Score.of(found.cross_validation[name])
            figures[f"{name}, %"] = 100.0 * score.rms
            figures[f"{name}: not valid, %"] = 100.0 * score.invalid
        figures["force deviation, N"] = float(
            np.mean([one.force_run_sd_n + one.force_window_sd_n for one in found.maps.surfaces.surfaces])
        )
    windows = form_windows(shaken, MotorSettings())
    figures["windows by fixes"] = float(len(windows.elapsed_s))
    return figures


def scomp_figures(recorded: Recorded) -> Figures:
    """Return parameters fitted to a drive."""
    found = identify(*read(recorded)).parameters
    return {
        "c_rr": found.pitch.rolling_resistance,
        "C_x, N": found.pitch.model.c_x_n,
        "C_x deviation": found.pitch.stiffness_sd,
        "slip deviation": found.pitch.fluctuation,
        "law at 0": found.two_segment_slip.slip_0,
        "roll gain": found.roll.gain,
        "gain deviation": found.roll.gain_sd,
        "angle deviation, deg": math.degrees(found.roll.rest + found.roll.alone),
        "angle memory, s": found.roll.rest_time_s + found.roll.alone_time_s,
        "compass, deg": math.degrees(found.compass.offset_sd_rad + found.compass.noise_rad),
        "gyro, deg": math.degrees(found.gyro.walk_rad_sqrt_s),
        "trace offset, deg": math.degrees(found.trace.offset_rad + found.trace.offset_sd_rad),
        "trace noise, deg": math.degrees(found.trace.noise_rad),
        "trace memory, s": found.trace.noise_time_s,
        "rear axle, m": found.rover.rear_axle_m,
    }


def gyro_figures(log: Path) -> Figures:
    """Return the constants of a gyro, and whether they may be used."""
    found = fit_response(read_turns(log))
    return {
        "gain": found.gain,
        "gain deviation": found.gain_sd,
        "delay, ms": 1e3 * found.delay_s,
        "delay deviation, ms": 1e3 * found.delay_sd_s,
        "lag, ms": 1e3 * found.lag_s,
        "lag deviation, ms": 1e3 * found.lag_sd_s,
        "blocks, s": found.seconds,
        "is used": float(not found.problem),
    }


def main() -> int:
    """Print one table for each object of numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--of", default="motor,slip,scomp,gyro")
    parser.add_argument("--groups", help="with commas; all of them when left out")
    parser.add_argument("--data", type=Path, default=DATA)
    given = parser.parse_args()
    names = given.of.split(",")
    refusals = (LogError, ModelError)
    if "motor" in names:
        print("\nmotor")
        score = partial(motor_figures, motor_records())
        print_table(MOTOR_FIT, score, groups=given.groups, refusals=refusals, effects_only=True)
    if "slip" in names:
        print("\nslip")
        folder = given.data / "one_surface_type"
        files = find_runs([folder]).files[::EVERY] if folder.is_dir() else ()
        score = partial(slip_figures, files, shaken_drive(1))
        print_table(
            SLIP_FIT, score, groups=given.groups, refusals=refusals, effects_only=True, leave_out=PROMISES
        )
    if "scomp" in names:
        print("\nscomp")
        score = partial(scomp_figures, field_test(TESTS["test_1"], FIRST_SEED))
        print_table(SCOMP_FIT, score, groups=given.groups, refusals=refusals, effects_only=True)
    if "gyro" in names:
        print("\ngyro")
        with TemporaryDirectory() as folder:
            found = Path(folder) / "gyro.toml"
            with redirect_stdout(StringIO()):
                run(GyroCalibration(), Request(source="robotino", virtual=True, out=found))
            score = partial(gyro_figures, found.with_suffix(".mcap"))
            print_table(GYRO_FIT, score, groups=given.groups, refusals=refusals, effects_only=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
