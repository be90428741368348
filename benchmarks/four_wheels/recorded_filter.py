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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.four_wheels.consistency import Errors, find_errors, print_errors, shown_trace
from benchmarks.four_wheels.field_drives import MOUNDS, SIDEWAYS, draw_rover, field_drive
from controllers.estimation.settings import FilterSettings
from controllers.slip.scomp.parameters import ScompParameters
from controllers.slip.scomp.states import ScompStates
from drivers.samples import PoseFixSample
from rover_hil.config import load_config
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.identify.scomp.fit import identify
from rover_hil.scomp.columns import drive_of
from rover_hil.scomp.files import truth_of
from rover_hil.scomp.recorded_samples import FIXES as FIXES_DEVICE
from rover_hil.scomp.recorded_samples import RecordedSamples, recorded_estimator
from tests.nature import four_wheel_drive as nature

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

PLANTS = ("nature", "el_dorado")
FIXES = ("no fixes", "fixes in the first half", "fixes")
GROUNDS = ("known", "unknown")
REST_S = 2.0
COMPASS_ROWS, TRACE_ROWS, FIX_ROWS, FIX_LATE_ROWS, REPORT_ROWS = 2, 4, 40, 2, 10
FIX_SD = 0.01


@dataclass(frozen=True, slots=True)
class Recorded:
    """A drive: its log and its truth, at the same rows, 20 Hz."""

    log: Columns
    truth: Columns

    @property
    def path(self) -> TruePoses:
        """The true path."""
        return truth_of(self.truth, "simulated")

    def poses(self) -> Array:
        """Return the true poses in the frame of the start, shape (n, 3)."""
        truth = self.truth
        way = (truth["x_m"] - truth["x_m"][0]) + 1j * (truth["y_m"] - truth["y_m"][0])
        way = way * np.exp(-1j * truth["yaw_rad"][0])
        return np.column_stack([way.real, way.imag, truth["yaw_rad"] - truth["yaw_rad"][0]])


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


def estimate(drive: Recorded, parameters: ScompParameters, settings: FilterSettings, fixes: str) -> Errors:
    """Return the errors of each half second of the drive, of its second half where fixes end."""
    rows, _ = drive_of(dict(drive.log), "simulated")
    t_s, poses = rows.t_s, drive.poses()
    if rows.compass_rad is not None:
        rows.compass_rad[np.arange(len(t_s)) % COMPASS_ROWS != 0] = np.nan
    if fixes != "no fixes":
        rows = replace(rows, fix_m=np.full((len(t_s), 2), np.nan))  # a device; its fixes follow
    recorded = RecordedSamples(rows, parameters, None)
    estimator = recorded_estimator(recorded, parameters, settings, ScompStates(parameters))
    rng = np.random.default_rng(3)
    ends = len(t_s) // 2 if fixes == "fixes in the first half" else len(t_s)
    errors: Errors = []
    for row in range(len(t_s)):
        t_ns = recorded.t_ns(row)
        for sample in recorded.of_row(row):
            if not isinstance(sample, PoseFixSample):  # as in the loop, nothing ties the floor to the start
                estimator.take(sample, t_ns)
        seen = row - FIX_LATE_ROWS
        if fixes != "no fixes" and seen % FIX_ROWS == 0 and 0 <= seen < ends:
            x_m, y_m, yaw_rad = (poses[seen] + rng.normal(0.0, FIX_SD, 3)).tolist()
            fix = PoseFixSample(
                device=FIXES_DEVICE,
                t_ns=t_ns,
                t_capture_ns=recorded.t_ns(seen),
                x_m=x_m,
                y_m=y_m,
                yaw_rad=yaw_rad,
                position_std_m=FIX_SD,
                yaw_std_rad=FIX_SD,
            )
            estimator.take(fix, t_ns)
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
