"""The pose filter of the loop on recorded drives of both field tests: errors, and NEES.

    python -m benchmarks.four_wheels.recorded_filter [--seeds 4] [--first 100] [--plant nature]

The sensors of a recorded drive are fed to the estimator of the control loop, row by row. Plants: `nature`,
the independent one of `tests/nature/four_wheel_drive.py`; `el_dorado`, that of the field tests, half a minute
a seed. The ground is known where the parameters are those that `identify` fits to test 1 of the same seed,
unknown where they are from the next seed. Pose fixes every 2 s (10 mm, 0.6 deg, 0.1 s late) come always, in
the first half of the drive, or not at all. No pictures are rendered.

Prints for each ground, use of fixes and test, over the seeds: median and greatest error at the end; for
position and yaw, from every half second (after the last fix, where fixes end) the share inside the 95 %
ellipse, the mean NEES over the dimension, and root mean squares of error and reported standard deviation.
"""

import argparse
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.four_wheels.consistency import (
    CAMERA,
    FIX_DEVICE,
    Errors,
    find_errors,
    print_errors,
    shown_trace,
)
from benchmarks.four_wheels.field_drives import MOUNDS, SIDEWAYS, draw_rover, field_drive
from controllers.estimation.settings import FilterSettings
from controllers.estimator import Estimator
from controllers.ftrace.reading import TraceReading
from controllers.motion.kinematics import SkidSteerKinematics
from controllers.motion.rover_geometry import SkidSteerRoverSettings
from controllers.roles import DeviceRoles
from controllers.slip.scomp.compensator import ScompCompensator
from controllers.slip.scomp.parameters import ScompParameters
from controllers.slip.scomp.settings import ScompSettings
from drivers.clock import nanoseconds
from drivers.samples import (
    AttitudeSample,
    FrameSample,
    HeadingReference,
    HeadingSample,
    PoseFixSample,
    RateSample,
    Sample,
    WheelSample,
)
from rover_hil.config import load_config
from rover_hil.identify.scomp.fit import identify
from rover_hil.scomp.columns import drive_of
from rover_hil.scomp.drive import TruePath
from rover_hil.scomp.recorded_samples import RecordedTrace
from tests.nature import four_wheel_drive as nature

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

PLANTS = ("nature", "el_dorado")
FIXES = ("no fixes", "fixes in the first half", "fixes")
GROUNDS = ("known", "unknown")
ROVER = SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.092, track_m=0.66)
START_NS = nanoseconds(1.0)
REST_S = 2.0
COMPASS_ROWS, TRACE_ROWS, FIX_ROWS, FIX_LATE_ROWS, REPORT_ROWS = 2, 4, 40, 2, 10
FIX_SD = 0.01


@dataclass(frozen=True, slots=True)
class Recorded:
    """A drive: its log and its truth, at the same rows, 20 Hz."""

    log: Columns
    truth: Columns

    @property
    def path(self) -> TruePath:
        """The true path."""
        truth = self.truth
        return TruePath(t_s=truth["t_s"], x_m=truth["x_m"], y_m=truth["y_m"], psi_rad=truth["psi_rad"])

    def poses(self) -> Array:
        """Return the true poses in the frame of the start, shape (n, 3)."""
        truth = self.truth
        way = (truth["x_m"] - truth["x_m"][0]) + 1j * (truth["y_m"] - truth["y_m"][0])
        way = way * np.exp(-1j * truth["psi_rad"][0])
        return np.column_stack([way.real, way.imag, truth["psi_rad"] - truth["psi_rad"][0]])


def drives_of(plant: str, seed: int) -> dict[str, Recorded]:
    """Return the drives of both tests."""
    if plant == "nature":
        sites = {"test 1": nature.SIDEWAYS, "test 2": nature.MOUNDS}
        by_site = {name: nature.field_test(site, seed) for name, site in sites.items()}
        return {name: Recorded(drive.log, drive.truth) for name, drive in by_site.items()}
    rover = draw_rover(seed)
    drives: dict[str, Recorded] = {}
    for name, site in (("test 1", SIDEWAYS), ("test 2", MOUNDS)):
        drive = field_drive(rover, site, seed)
        true_deg = np.array([frame.theta_t_deg for frame in drive.sequence.truth])
        present = np.array([frame.trace_present for frame in drive.sequence.truth])
        seen_deg, is_seen = shown_trace(np.nan_to_num(true_deg), present, np.random.default_rng([seed, 9]))
        rows = np.arange(len(drive.log["t_s"]))
        frame = np.minimum(rows // TRACE_ROWS, len(true_deg) - 1)
        trace = {
            "beta_ftrace_deg": seen_deg[frame],
            "beta_valid": is_seen[frame].astype(float),
            "beta_new": (rows % TRACE_ROWS == 0).astype(float),
        }
        drives[name] = Recorded({**drive.log, **trace}, drive.truth)
    return drives


def samples(log: Columns, row: int, t_ns: int, trace: RecordedTrace) -> list[Sample]:
    """Return what arrives with a row."""
    value = {name: float(column[row]) for name, column in log.items()}
    samples_of_drive: list[Sample] = [
        WheelSample(device="wheels", t_ns=t_ns, wheel=wheel, position_rad=value[f"enc{wheel + 1}_rad"])
        for wheel in range(4)
    ]
    samples_of_drive.append(
        RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=math.radians(value["gyro_z_deg_s"]))
    )
    pitch_rad, roll_rad = -math.radians(value["pitch_deg"]), math.radians(value["roll_deg"])
    samples_of_drive.append(AttitudeSample(device="imu", t_ns=t_ns, pitch_rad=pitch_rad, roll_rad=roll_rad))
    if row % COMPASS_ROWS == 0:
        heading_rad = math.radians(value["compass_deg"])
        samples_of_drive.append(
            HeadingSample(
                device="compass", t_ns=t_ns, heading_rad=heading_rad, reference=HeadingReference.MAGNETIC
            )
        )
    if value["beta_new"]:
        seen = bool(value["beta_valid"])
        trace.reading = TraceReading(
            t_ns=t_ns,
            detected=seen,
            theta_rad=math.radians(value["beta_ftrace_deg"]) if seen else None,
            confidence=float(seen),
            source="trace" if seen else "none",
            theta_sd_rad=None,
        )
        picture = np.zeros((1, 1), np.uint8)
        samples_of_drive.append(
            FrameSample(device=CAMERA, t_ns=t_ns, t_capture_ns=None, index=row, image=picture)
        )
    return samples_of_drive


def estimate(drive: Recorded, parameters: ScompParameters, settings: FilterSettings, fixes: str) -> Errors:
    """Return the errors of each half second of the drive, of its second half where fixes end."""
    trace, kinematics = RecordedTrace(), SkidSteerKinematics(ROVER)
    roles = DeviceRoles(
        wheels="wheels",
        required={},
        gyro="imu",
        headings=("compass",),
        camera=CAMERA,
        fixes=() if fixes == "no fixes" else (FIX_DEVICE,),
    )
    slip = ScompCompensator(ScompSettings(parameters=parameters), roles, kinematics, trace)
    estimator = Estimator(kinematics, settings, 4.0, roles, slip)
    rng = np.random.default_rng(3)
    poses, t_s = drive.poses(), drive.log["t_s"]
    ends = len(t_s) // 2 if fixes == "fixes in the first half" else len(t_s)
    errors: Errors = []
    for row in range(len(t_s)):
        t_ns = START_NS + nanoseconds(float(t_s[row]))
        arrived = samples(drive.log, row, t_ns, trace)
        seen = row - FIX_LATE_ROWS
        if fixes != "no fixes" and seen % FIX_ROWS == 0 and 0 <= seen < ends:
            x_m, y_m, yaw_rad = (poses[seen] + rng.normal(0.0, FIX_SD, 3)).tolist()
            arrived.append(
                PoseFixSample(
                    device=FIX_DEVICE,
                    t_ns=t_ns,
                    t_capture_ns=START_NS + nanoseconds(float(t_s[seen])),
                    x_m=x_m,
                    y_m=y_m,
                    yaw_rad=yaw_rad,
                    position_std_m=FIX_SD,
                    yaw_std_rad=FIX_SD,
                )
            )
        for sample in arrived:
            estimator.take(sample, sample.t_ns)
        is_driven = t_s[row] > REST_S
        estimator.advance(t_ns, (float(is_driven),) * 4)
        is_judged = ends == len(t_s) or row > ends + FIX_LATE_ROWS
        if row % REPORT_ROWS == 0 and is_driven and is_judged:
            errors.append(find_errors(estimator.estimate(t_ns), poses[row]))
    return errors


def main() -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--plant", choices=PLANTS, default="nature")
    arguments = parser.parse_args()
    settings = load_config("el-dorado").filter
    drives = [drives_of(arguments.plant, arguments.first + number) for number in range(arguments.seeds + 1)]
    fitted = [
        identify(drive_of(dict(drive["test 1"].log), "simulated")[0], drive["test 1"].path).parameters
        for drive in drives
    ]
    for known, ground in enumerate(reversed(GROUNDS)):
        for fixes in FIXES:
            for test in ("test 1", "test 2"):
                results = [
                    estimate(drives[seed][test], fitted[seed + 1 - known], settings, fixes)
                    for seed in range(arguments.seeds)
                ]
                ends_m = [math.sqrt(errors[-1][1]) for errors in results]
                name = f"{ground}, {fixes}, {test}"
                print(f"{name}: end {np.median(ends_m):.3f} m, greatest {max(ends_m):.3f} m")
                print_errors(name, np.array([row for errors in results for row in errors]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
