"""The field tests of paper 000 with slip measured by the camera, beside slip estimated by sComp.

    python -m benchmarks.four_wheels.field_ground_motion [--seeds 3] [--first 1000]

The drives of `benchmarks.four_wheels.field_tests`, same seeds. The control loop of the shipped El-Dorado
observes them without slip law and trace: encoders, gyro, compass, and the motion over the ground in the
rendered frames. Prints for each seed and test the position error at the end, in m: `camera_m` with the rig
file alone, `calibrated_m` with the scale of test 1, from a fix at either end of it; `ours` by sComp with the
trace, whose parameters are identified on test 1 too. And of the calibrated one: the error at the end along
and across the direction to the goal, that of the yaw, the rms error of the slip, the share of the cycles with
a valid motion, and the reported standard deviation. Exit code 1 where its error at the end is not smaller.
"""

import argparse
import json
import math
import sys

import numpy as np

from benchmarks.four_wheels.field_drives import FieldDrive, draw_rover, field_drive
from benchmarks.four_wheels.field_tests import FIRST_SEED, SITES, STARTED_S, run_seed
from controllers.control_loop import ControlLoop
from controllers.estimation.ground.travel import WHEELS_SD
from controllers.ground_motion.live_ground_motion import LiveGroundMotion
from controllers.ground_motion.rig import RigFile
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.settings import GroundMotionSettings
from controllers.roles import DeviceRoles
from drivers.camera.settings import CameraSettings
from drivers.clock import nanoseconds
from drivers.samples import FrameSample, HeadingReference, HeadingSample, RateSample, Sample, WheelSample
from rover_hil.config import load_config

ROLES = DeviceRoles(
    wheels="wheels", required={}, gyro="imu", headings=("compass",), camera="camera", wheel_age_s=0.0
)


def make_loop(recorded: FieldDrive, tolerance: RigTolerance) -> ControlLoop:
    """Return the loop that observes a drive with its camera."""
    config = load_config("el-dorado")
    rig = RigFile.model_validate(recorded.sequence.rig.as_json())
    ground = GroundMotionSettings(rig=rig, tolerance=tolerance)
    camera = config.devices["camera"]
    assert isinstance(camera, CameraSettings)
    camera = camera.model_copy(update={"width": rig.image.width, "height": rig.image.height})
    rover = config.rover.model_copy(update={"track_m": 2.0 * recorded.sequence.rig.wheel.y_m})
    config = config.model_copy(
        update={"mission": None, "scomp": None, "ground_motion": ground, "rover": rover}
    )
    meter = LiveGroundMotion(ground, camera, rotates_about_origin=False)
    return ControlLoop(config, ROLES, None, meter)


def observe(recorded: FieldDrive, tolerance: RigTolerance) -> dict[str, float]:
    """Return how far the estimate ends off the truth, how good the measured slip was, and the true scale."""
    loop, log, truth = make_loop(recorded, tolerance), recorded.log, recorded.truth
    frames = zip(recorded.sequence.telemetry, recorded.sequence.frames(), strict=True)
    waiting, slips, valid = next(frames, None), [], 0
    tilt_rates_rad_s, compass_deg, output = (0.0, 0.0), math.nan, None
    for row, t_s in enumerate(log["t_s"].tolist()):
        t_ns = nanoseconds(1.0 + t_s)
        samples: list[Sample] = [
            WheelSample(
                device="wheels", t_ns=t_ns, wheel=wheel, position_rad=log[f"position{wheel + 1}_rad"][row]
            )
            for wheel in range(4)
        ]
        if log["heading_deg"][row] != compass_deg:
            compass_deg = log["heading_deg"][row]
            heading_rad = math.remainder(math.radians(compass_deg), math.tau)
            samples.append(
                HeadingSample(
                    device="compass",
                    t_ns=t_ns,
                    heading_rad=heading_rad,
                    reference=HeadingReference.MAGNETIC,
                )
            )
        if waiting is not None and waiting[0].t <= t_s:
            telemetry, image = waiting
            tilt_rates_rad_s = math.radians(telemetry.gyro_roll_dps), math.radians(telemetry.gyro_pitch_dps)
            frame_ns = nanoseconds(1.0 + telemetry.t)
            samples.append(
                FrameSample(device="camera", t_ns=t_ns, image=image, t_capture_ns=frame_ns, index=row)
            )
            waiting = next(frames, None)
        samples.append(
            RateSample(
                device="imu",
                t_ns=t_ns,
                rate_z_rad_s=math.radians(log["yaw_rate_deg_s"][row]),
                rate_x_rad_s=tilt_rates_rad_s[0],
                rate_y_rad_s=tilt_rates_rad_s[1],
            )
        )
        output = loop.step(t_ns, samples)
        assert output.ground is not None
        if t_s > STARTED_S:
            valid += not output.ground.reason
            if output.ground.slip is not None:
                slips.append(output.ground.slip - truth["slip"][row])
    assert output is not None
    estimate, start_rad = output.estimate, float(truth["yaw_rad"][0])
    moved_m = complex(truth["x_m"][-1] - truth["x_m"][0], truth["y_m"][-1] - truth["y_m"][0])
    moved_m *= complex(math.cos(start_rad), -math.sin(start_rad))
    xx, _, _, yy, _, _ = estimate.covariance
    measured_m = complex(estimate.x_m, estimate.y_m)
    turned_rad = float(truth["yaw_rad"][-1]) - start_rad
    off_m = (measured_m - moved_m) * moved_m.conjugate() / abs(moved_m)
    return {
        "end_m": abs(off_m),
        "along_m": off_m.real,
        "across_m": off_m.imag,
        "yaw_deg": math.degrees(math.remainder(estimate.yaw_rad - turned_rad, math.tau)),
        "scale": abs(moved_m) ** 2 / (measured_m * moved_m.conjugate()).real,
        "told_sd_m": math.sqrt(xx + yy),
        "slip_rms": float(np.sqrt(np.mean(np.square(slips)))),
        "valid": valid / float(np.sum(log["t_s"] > STARTED_S)),
    }


def main() -> int:
    """Print the figures; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=FIRST_SEED)
    arguments = parser.parse_args()
    is_better = True
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        rover = draw_rover(seed)
        scomp = run_seed(seed, "fused", None)
        calibrated: RigTolerance | None = None
        for name, site in SITES.items():
            recorded = field_drive(rover, site, seed)
            by_rig = observe(recorded, RigTolerance())
            calibrated = calibrated or RigTolerance(scale=by_rig["scale"], scale_sd=WHEELS_SD)
            figures = observe(recorded, calibrated)
            ours = {odometry: score["final_m"] for odometry, score in scomp[name].scores.items()}
            is_better = is_better and figures["end_m"] < ours["ours"]
            ends = {"camera_m": by_rig["end_m"], "calibrated_m": figures.pop("end_m"), **ours}
            rounded = {key: round(value, 3) for key, value in {**ends, **figures}.items()}
            print(json.dumps({"seed": seed, "test": name, **rounded}), flush=True)
    return 0 if is_better else 1


if __name__ == "__main__":
    sys.exit(main())
