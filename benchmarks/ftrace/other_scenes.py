"""Trace finders on drives of another renderer, `tests/nature/trace_scene.py`; scores of `rendered_drives`.

    python -m benchmarks.ftrace.other_scenes [--sets easy,curved] [--looks dark,bars] [--seeds 1]
                                             [--first-seed 1000] [--seconds S] [--methods fused,hough]
                                             [--no-peers] [--pictures FOLDER]

`controllers/ftrace` was developed on `sim_backends/rear_scene`; this renderer shares no code with it: rays
instead of a map, ruts with looks of their own. Seeds from 1000 are held out. Prints a line per drive and
finder, per look, and for all but `sparse`. Where no looks are named, each drive has the next one in turn.
"""

import argparse
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.ftrace.rendered_drives import COLUMNS, METHODS, drive_through
from benchmarks.ftrace.scores import Judged, figures, together
from drivers.samples import Image
from sim_backends.rear_scene.rig import Wheel
from tests.nature import trace_drive
from tests.nature.trace_drive import SETS, Drive
from tests.nature.trace_rut import LOOKS
from tests.nature.trace_scene import TraceScene
from tests.nature.trace_sets import make_drive
from tests.rear_scene.motion import RATE_HZ, Motion
from tests.rear_scene.rig_file import CalibratedRig
from tests.rear_scene.sequence import FrameSequence
from tests.rear_scene.truth import FrameTruth, Telemetry

FIRST_HELD_OUT_SEED = 1000


class OtherSequence(FrameSequence):
    """A drive of the other renderer in the form that `benchmarks.ftrace.rendered_drives` scores.

    Args:
        drive: What is driven.
        look: How its ruts look.
    """

    def __init__(self, drive: Drive, look: str) -> None:
        self.name, self.seed = f"{drive.name}_{look}", drive.seed
        self.rig, self.motion = _rig(drive), _motion(drive)
        self._steps = list(drive.steps)
        self._scene = TraceScene(drive, look)
        self.truth = [_truth(row) for row in drive.truth()]
        self.telemetry = [Telemetry(**vars(row)) for row in drive.telemetry()]

    def frames(self) -> Iterator[Image]:
        """Render the frames in order of time."""
        return self._scene.frames()


def main() -> int:
    """Run all; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--sets", default=",".join(SETS), help="names, with commas between")
    parser.add_argument(
        "--looks", help="of ruts, with commas between: each drive in each; in turn where not given"
    )
    parser.add_argument("--seeds", type=int, default=1, help="drives per set")
    parser.add_argument("--first-seed", type=int, default=FIRST_HELD_OUT_SEED, help="below 1000: development")
    parser.add_argument(
        "--seconds", type=float, help="length of each drive but sparse ones; its own where not given"
    )
    parser.add_argument("--methods", default=",".join(METHODS), help="of ours, with commas between")
    parser.add_argument("--no-peers", action="store_true", help="leave the peers out")
    parser.add_argument("--pictures", type=Path, help="folder for frames with the trace drawn in")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    methods = [method for method in METHODS if method in given.methods.split(",")]
    sys.stdout.write(f"| drive | finder | frames | {' | '.join(COLUMNS.values())} |\n")
    sys.stdout.write("|---" * (len(COLUMNS) + 3) + "|\n")
    pooled: dict[str, dict[str, list[Judged]]] = {}
    for number, name in enumerate(name for name in SETS if name in given.sets.split(",")):
        for seed in range(given.first_seed, given.first_seed + given.seeds):
            turn = LOOKS[(number + 3 * seed) % len(LOOKS)]
            for look in given.looks.split(",") if given.looks else (turn,):
                seconds = None if name == "sparse" else given.seconds
                sequence = OtherSequence(make_drive(name, seed, seconds), look)
                judged = drive_through(sequence, methods, not given.no_peers, given.pictures)
                _report(
                    f"{name} {seed} {look}",
                    {finder: [judged_drive] for finder, judged_drive in judged.items()},
                )
                for pool in (f"look {look}", "all") if name != "sparse" else ():
                    for finder, judged_drive in judged.items():
                        pooled.setdefault(pool, {}).setdefault(finder, []).append(judged_drive)
    for pool in sorted(pooled, key=lambda name: (name == "all", name)):
        _report(pool, pooled[pool])
    return 0


def _report(name: str, parts: Mapping[str, Sequence[Judged]]) -> None:
    for finder, some in parts.items():
        values = figures(together(some))
        cells = ["-" if math.isnan(values[key]) else f"{values[key]:.2f}" for key in COLUMNS]
        sys.stdout.write(f"| {name} | {finder} | {int(values['frames'])} | {' | '.join(cells)} |\n")
    sys.stdout.flush()


def _rig(drive: Drive) -> CalibratedRig:
    """Return the rig as the peers take it."""
    wheels = [
        Wheel(
            name=wheel.name,
            x_m=wheel.x_m,
            y_m=wheel.y_m,
            radius_m=wheel.radius_m,
            width_m=wheel.width_m,
            grouser_height_m=wheel.lug_m,
            lug_count=wheel.lug_count,
            steer_deg=float(np.degrees(wheel.steer_rad)),
        )
        for wheel in drive.wheels
    ]
    return CalibratedRig(
        width=trace_drive.WIDTH,
        height=trace_drive.HEIGHT,
        fps=drive.frames_hz,
        camera_matrix=drive.camera.matrix,
        distortion=drive.camera.distortion,
        vehicle_from_camera=drive.camera.axes,
        camera_m=drive.camera.place_m,
        wheel=wheels[0],
        other_wheels=tuple(wheels[1:]),
        b_m=-wheels[0].x_m,
        nominal_speed_m_s=drive.nominal_m_s,
        behind_contact_m=0.7,
        lateral_about_contact_m=0.4,
    )


def _motion(drive: Drive) -> Motion:
    """Return the motion as the scores take it; what they do not read is zero."""
    assert trace_drive.RATE_HZ == RATE_HZ
    moved, wheel = drive.motion, drive.wheels[0]
    count = len(moved.yaw_rad)
    none = np.zeros(count)
    cosine, sine = np.cos(moved.yaw_rad), np.sin(moved.yaw_rad)
    turn = np.zeros((count, 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = (
        cosine,
        -sine,
        sine,
        cosine,
        1.0,
    )
    contact_m = moved.wheel_way(wheel)
    velocity = np.gradient(contact_m, 1 / RATE_HZ, axis=0)
    return Motion(
        t_s=np.arange(count) / RATE_HZ,
        position_m=np.column_stack([moved.origin_m, none]),
        vehicle_to_world=turn,
        yaw_rad=moved.yaw_rad,
        pitch_rad=none,
        roll_rad=none,
        rock_rad=moved.rock_rad,
        wheel_angle_rad=none,
        rim_speed_m_s=moved.rim_m_s,
        slip=none,
        slip_angle_rad=none,
        yaw_rate_rad_s=moved.rate_rad_s[:, 2],
        softness=np.repeat(
            moved.takes_rut(moved.way_m)[:, None].astype(np.float64), len(drive.wheels), axis=1
        ),
        contact_m=np.column_stack([contact_m, none]),
        contact_velocity_m_s=trace_drive.turned(velocity, -moved.yaw_rad),
        velocity_m_s=np.zeros((count, 2)),
        body_rate_rad_s=moved.rate_rad_s,
    )


def _truth(row: trace_drive.Truth) -> FrameTruth:
    """Return the truth as the scores take it; what they do not read is NaN."""
    nothing = dict.fromkeys(
        (
            "x_m", "y_m", "yaw_deg", "pitch_deg", "roll_deg", "rock_roll_deg", "rock_pitch_deg", "slip",
            "slip_angle_deg", "yaw_rate_dps", "line_deg",
        ),
        float("nan"),
    )  # fmt: skip
    return FrameTruth(
        frame=row.frame,
        t=row.t,
        theta_t_deg=row.theta_deg,
        d_t_m=row.distance_m,
        chord_deg=row.chord_deg,
        chord_d_m=row.chord_distance_m,
        visible_m=row.visible_m,
        trace_present=row.present,
        usable=row.usable,
        **nothing,
    )


if __name__ == "__main__":
    sys.exit(main())
