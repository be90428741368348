"""Numbers of `rover-hil identify` and of `calibrate imu`.

- motor: both simulated motors of `benchmarks/robotino/motor_identification.py`, a short staircase, one seed.
- slip: every fifth measured run of a data set (left out where it is absent), and a simulated drive with pose
  fixes and a yaw excitation, whose slip is twice its transmission loss.
- scomp_fit: a simulated field test of `benchmarks/four_wheels/scomp.py`.
- gyro: a virtual run of `rover-hil calibrate imu`.
"""

import atexit
import math
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp

import numpy as np

from benchmarks.four_wheels.scomp import FIRST_SEED, TESTS, read
from benchmarks.robotino.motor_identification import CASES, record, truth
from benchmarks.sensitivity import subject
from benchmarks.sensitivity.subject import Subject
from controllers.motion.kinematics import OmniKinematics
from controllers.slip.effort.motor_model import MotorSettings
from drivers.errors import LogError, ModelError
from rover_hil.drives.robotino_csv import ROBOTINO
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.record import MotorSignals
from rover_hil.identify.motor.report import report_motor
from rover_hil.identify.scomp.fit import identify
from rover_hil.identify.scomp.parameters import SCOMP_FIT
from rover_hil.identify.slip.form_windows import form_windows
from rover_hil.identify.slip.identification import identify_slip_maps, read_all
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import AlignedReadings
from rover_hil.identify.slip.runs import find_runs
from rover_hil.identify.slip.scores import Score
from rover_hil.ready.imu.calibration import GyroCalibration
from rover_hil.ready.imu.fit import fit_response
from rover_hil.ready.imu.parameters import GYRO_FIT
from rover_hil.ready.imu.turns import read_turns
from rover_hil.ready.procedure import Request, run
from tests.nature.four_wheel_drive import Recorded, field_test
from tests.nature.motor import measure, staircase

DATA = Path(__file__).resolve().parents[3] / "shared/data/robotino_2023/one_surface_type"
EVERY = 5
FIX_SD_M = 0.0025  # of the simulated drive
LOSSES = (0.0, 0.1, 0.2, 0.3, 0.4)
STRETCH_S = 24.0
SPEED_M_S = 0.15

Figures = Mapping[str, float]


def prepare_motors(cases: Sequence[str]) -> subject.Score:
    """Return what computes the figures of these simulated motors."""
    motors = dict(zip(("free", "loaded"), enumerate(CASES.values()), strict=True))
    records = {}
    for case in cases:
        seed, (motor, has_voltage) = motors[case]
        rng = np.random.default_rng(seed)
        measured = measure(motor, staircase((50.0, 100.0, 150.0)), 1, rng, delay_spread_s=0.01)
        records[case] = (record(measured, 0, voltage=has_voltage), truth(motor))
    return partial(motor_figures, records)


def motor_figures(records: Mapping[str, tuple[MotorSignals, dict[str, float]]]) -> Figures:
    """Return for each motor the rms error and the rms half interval of the parameters with an interval."""
    figures = {}
    for label, (item, true) in records.items():
        report = report_motor([item])
        errors, halves = [], []
        for estimate in report.estimates:
            value, low, high = estimate.value, estimate.low, estimate.high
            if value is not None and low is not None and high is not None and estimate.name in true:
                errors.append(value / true[estimate.name] - 1.0)
                halves.append(0.5 * (high - low) / true[estimate.name])
        figures[f"{label}: error, %"] = 100.0 * math.sqrt(float(np.mean(np.square(errors))))
        figures[f"{label}: half interval, %"] = 100.0 * math.sqrt(float(np.mean(np.square(halves))))
        figures[f"{label}: determined"] = float(sum(estimate.determined for estimate in report.estimates))
        figures[f"{label}: notes"] = float(len(report.notes) + len(report.undetermined))
    return figures


def shaken_drive(seed: int) -> AlignedReadings:
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
    return AlignedReadings(
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
        fix_sd_m=np.full(len(poses), FIX_SD_M),
    )


def prepare_slip(cases: Sequence[str]) -> subject.Score:
    """Return what computes the figures of a simulated drive and of the measured runs of a folder."""
    seeds = [int(case.removeprefix("shaken:")) for case in cases if case.startswith("shaken:")]
    folders = [Path(case) for case in cases if not case.startswith("shaken:")]
    files = [run for folder in folders if folder.is_dir() for run in find_runs([folder]).files[::EVERY]]
    return partial(slip_figures, files, [shaken_drive(seed) for seed in seeds])


def slip_figures(files: Sequence[Path], shaken: Sequence[AlignedReadings]) -> Figures:
    """Return scale and cross-validated errors of the measured runs, and windows of the drives with fixes."""
    figures: dict[str, float] = {}
    if files:
        identification = identify_slip_maps(read_all(files, MotorSettings(), lambda: None), lambda: None)
        figures["scale, mm/px"] = identification.scale.mm_per_px or math.nan
        figures["is a scale error"] = float(bool(identification.scale.is_scale_error))
        for name in ("isotonic_m", "best"):
            score = Score.of(identification.cross_validation[name])
            figures[f"{name}, %"] = 100.0 * score.rms
            figures[f"{name}: not valid, %"] = 100.0 * score.invalid
        surfaces = identification.maps.surfaces.surfaces
        deviations_n = [surface.force_run_sd_n + surface.force_window_sd_n for surface in surfaces]
        figures["force deviation, N"] = float(np.mean(deviations_n))
    windows = [form_windows(drive, MotorSettings()) for drive in shaken]
    figures["windows by fixes"] = float(sum(len(each.elapsed_s) for each in windows))
    return figures


def prepare_scomp(cases: Sequence[str]) -> subject.Score:
    """Return what fits the parameters to a simulated field test."""
    name, seed = cases[0].split(":")
    return partial(scomp_figures, field_test(TESTS[name], int(seed)))


def scomp_figures(recorded: Recorded) -> Figures:
    """Return parameters fitted to a drive."""
    fitted = identify(*read(recorded)).parameters
    return {
        "c_rr": fitted.pitch.rolling_resistance,
        "C_x, N": fitted.pitch.model.c_x_n,
        "C_x deviation": fitted.pitch.stiffness_sd,
        "slip deviation": fitted.pitch.fluctuation,
        "law at 0": fitted.two_segment_slip.slip_0,
        "roll gain": fitted.roll.gain,
        "gain deviation": fitted.roll.gain_sd,
        "angle deviation, deg": math.degrees(fitted.roll.rest + fitted.roll.alone),
        "angle memory, s": fitted.roll.rest_time_s + fitted.roll.alone_time_s,
        "compass, deg": math.degrees(fitted.compass.offset_sd_rad + fitted.compass.noise_rad),
        "gyro, deg": math.degrees(fitted.gyro.walk_rad_sqrt_s),
        "trace offset, deg": math.degrees(fitted.trace.offset_rad + fitted.trace.offset_sd_rad),
        "trace noise, deg": math.degrees(fitted.trace.noise_rad),
        "trace memory, s": fitted.trace.noise_time_s,
        "rear axle, m": fitted.rover.rear_axle_m,
    }


def prepare_gyro(cases: Sequence[str]) -> subject.Score:
    """Return what fits the gyro to a virtual run of a configuration."""
    folder = Path(mkdtemp())
    atexit.register(rmtree, folder)
    out = folder / "gyro.toml"
    with redirect_stdout(StringIO()):
        run(GyroCalibration(), Request(source=cases[0], virtual=True, out=out))
    return partial(gyro_figures, out.with_suffix(".mcap"))


def gyro_figures(log: Path) -> Figures:
    """Return the constants of a gyro, and whether they may be used."""
    response = fit_response(read_turns(log))
    return {
        "gain": response.gain,
        "gain deviation": response.gain_sd,
        "delay, ms": 1e3 * response.delay_s,
        "delay deviation, ms": 1e3 * response.delay_sd_s,
        "lag, ms": 1e3 * response.lag_s,
        "lag deviation, ms": 1e3 * response.lag_sd_s,
        "blocks, s": response.seconds,
        "is used": float(not response.problem),
    }


REFUSALS = (LogError, ModelError)
SUBJECTS = {
    "motor": Subject(parameters=MOTOR_FIT, cases="free,loaded", prepare=prepare_motors, refusals=REFUSALS),
    "slip": Subject(
        parameters=SLIP_FIT,
        cases=f"shaken:1,{DATA}",
        prepare=prepare_slip,
        fixed=("surface.least_runs",),  # documents promise it
        refusals=REFUSALS,
    ),
    "scomp_fit": Subject(
        parameters=SCOMP_FIT, cases=f"test_1:{FIRST_SEED}", prepare=prepare_scomp, refusals=REFUSALS
    ),
    "gyro": Subject(parameters=GYRO_FIT, cases="robotino", prepare=prepare_gyro, refusals=REFUSALS),
}
