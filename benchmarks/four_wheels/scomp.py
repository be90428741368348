"""The two field tests of paper 000, simulated: how far off is each odometry at the end?

    python -m benchmarks.four_wheels.scomp [--seeds 20] [--pictures FOLDER]

Test 1 is a traverse of 7 m with a large mound from the side, test 2 one of 13 m over five mounds; both on
one soil with one rover, drawn anew for each seed. All parameters come from test 1. Prints as JSON for each
odometry, over the seeds, the median and the greatest final error (eq 18) and the median rms of slip angle,
slip and heading; then how honest the estimator is: mean NIS of its sensors, and rms of the final error over
its standard deviation. Exit code 1 when the on-line estimate misses a bar.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.four_wheels.scomp_peers import compass_track, paper_track, plain_track
from controllers.slip.scomp.parameters import ScompParameters
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.identify.scomp.fit import identify
from rover_hil.identify.scomp.pictures import drive_pictures, model_pictures
from rover_hil.pages.atomic_write import write_files
from rover_hil.scomp.columns import drive_of
from rover_hil.scomp.drive import SensorRows, Track, final_error_m
from rover_hil.scomp.files import truth_of
from rover_hil.scomp.odometry import Result, estimate_track
from tests.nature.four_wheel_drive import MOUNDS, SIDEWAYS, Recorded, Site, field_test

TESTS = {"test_1": SIDEWAYS, "test_2": MOUNDS}
BARS = {"test_1": 0.12, "test_2": 0.25}
SLIP_ANGLE_BAR_DEG, SLIP_BAR, HEADING_BAR_DEG = 1.0, 0.05, 0.3
FIRST_SEED = 100
STARTED_S = 3.5

Method = Callable[[SensorRows, ScompParameters], Track]


@dataclass(frozen=True, kw_only=True)
class Scores:
    """The errors of one path."""

    final_m: float
    slip_angle_deg: float
    slip: float
    heading_deg: float


def estimated(drive: SensorRows, parameters: ScompParameters) -> Track:
    return estimate_track(drive, parameters).track


def online(drive: SensorRows, parameters: ScompParameters) -> Track:
    return estimate_track(drive, parameters, online=True).track


METHODS: dict[str, Method] = {
    "plain": plain_track,
    "compass": compass_track,
    "scomp_paper": paper_track,
    "online": online,
    "whole_drive": estimated,
    "without_pitch": lambda drive, parameters: estimated(replace(drive, pitch_rad=None), parameters),
    "without_roll": lambda drive, parameters: estimated(replace(drive, roll_rad=None), parameters),
    "without_trace": lambda drive, parameters: estimated(replace(drive, trace_rad=None), parameters),
    "without_gyro": lambda drive, parameters: estimated(replace(drive, gyro_rad_s=None), parameters),
    "without_compass": lambda drive, parameters: estimated(replace(drive, compass_rad=None), parameters),
}


def read(recorded: Recorded) -> tuple[SensorRows, TruePoses]:
    truth = recorded.truth
    path = truth_of(truth, "simulated")
    return drive_of(recorded.log, "simulated")[0], path


def score(track: Track, recorded: Recorded, path: TruePoses) -> Scores:
    """Return the errors while the rover drives."""
    drives = path.t_s > STARTED_S

    def rms(values: np.ndarray, truth: str) -> float:
        return float(np.sqrt(np.mean((values - recorded.truth[truth])[drives] ** 2)))

    return Scores(
        final_m=final_error_m(track, path),
        slip_angle_deg=float(np.degrees(rms(track.slip_angle_rad, "slip_angle_rad"))),
        slip=rms(track.slip, "slip"),
        heading_deg=float(np.degrees(rms(track.heading_rad, "yaw_rad"))),
    )


def table(scores: Sequence[Scores]) -> dict[str, float]:
    return {
        "final_m": round(float(np.median([item.final_m for item in scores])), 3),
        "worst_m": round(max(item.final_m for item in scores), 3),
        "slip_angle_deg": round(float(np.median([item.slip_angle_deg for item in scores])), 2),
        "slip": round(float(np.median([item.slip for item in scores])), 3),
        "heading_deg": round(float(np.median([item.heading_deg for item in scores])), 2),
    }


def honesty(results: Sequence[tuple[Result, TruePoses]]) -> dict[str, float]:
    """Return mean NIS by sensor, and the final error over its standard deviation, rms over the drives."""
    shares: list[float] = []
    for result, path in results:
        track = result.track
        shares.append(float((track.x_m[-1] - path.x_m[-1]) / track.sigma_x_m[-1]))
        shares.append(float((track.y_m[-1] - path.y_m[-1]) / track.sigma_y_m[-1]))
    innovations = [innovation for result, _ in results for innovation in result.innovations]
    names = sorted({innovation.name for innovation in innovations})
    nis = {
        f"nis_{name.replace(' ', '_')}": [i.nis for i in innovations if i.name == name and i.nis is not None]
        for name in names
    }
    return {
        **{name: round(float(np.mean(values)), 2) for name, values in nis.items()},
        "final_error_over_sigma": round(float(np.sqrt(np.mean(np.square(shares)))), 2),
    }


def run_seed(seed: int, drawn: dict[str, Site]) -> dict[str, tuple[Recorded, ScompParameters]]:
    """Return the drives of a seed with the parameters that its test 1 gives."""
    recorded = {name: field_test(site, seed) for name, site in drawn.items()}
    parameters = identify(*read(recorded["test_1"])).parameters
    return {name: (drive, parameters) for name, drive in recorded.items()}


def draw(folder: Path, recorded: Recorded, parameters: ScompParameters, name: str) -> None:
    drive, path = read(recorded)
    names = ("online", "scomp_paper", "compass", "plain")
    tracks = {method: METHODS[method](drive, parameters) for method in names}
    pictures = drive_pictures(tracks, path) | model_pictures(parameters.pitch.model)
    write_files(folder / name, pictures)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    scores: dict[str, dict[str, list[Scores]]] = {name: {m: [] for m in METHODS} for name in TESTS}
    results: dict[str, list[tuple[Result, TruePoses]]] = {name: [] for name in TESTS}
    for seed in range(FIRST_SEED, FIRST_SEED + arguments.seeds):
        for name, (recorded, parameters) in run_seed(seed, TESTS).items():
            drive, path = read(recorded)
            results[name].append((estimate_track(drive, parameters), path))
            for method, run in METHODS.items():
                scores[name][method].append(score(run(drive, parameters), recorded, path))
            if arguments.pictures and seed == FIRST_SEED:
                draw(arguments.pictures, recorded, parameters, name)
    tables = {name: {m: table(of_method) for m, of_method in by.items()} for name, by in scores.items()}
    report = {name: {**tables[name], "honesty": honesty(results[name])} for name in TESTS}
    print(json.dumps({"seeds": arguments.seeds, **report}, indent=2))
    return 0 if all(reaches(tables[name]["online"], bar) for name, bar in BARS.items()) else 1


def reaches(row: dict[str, float], final_m: float) -> bool:
    return (
        row["final_m"] <= final_m
        and row["slip_angle_deg"] <= SLIP_ANGLE_BAR_DEG
        and row["slip"] <= SLIP_BAR
        and row["heading_deg"] <= HEADING_BAR_DEG
    )


if __name__ == "__main__":
    sys.exit(main())
