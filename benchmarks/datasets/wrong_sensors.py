"""Give measured drives wrong sensors: is that named, or does the region of the estimate contain the truth?

    python -m benchmarks.datasets.wrong_sensors ../shared/data/vehicles [--only WORD] [--seconds 60]

Twelve kinds of wrong sensors in four drives, from the last third, from the last two thirds and from the
beginning on. Three drives have no gyro: theirs is the turn of the truth with noise. The truth itself is not
imported; the last pose is compared with it: the 95 % region of its place (chi2, 2 degrees of freedom). The
car has a gyro and no truth: there a fault must be named. Prints one line each and the counts; exit code 1
where one is neither, or a sound drive has a finding.
"""

import argparse
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from benchmarks.datasets.planted_faults import (
    TRUTH,
    Measured,
    beginning,
    car,
    differential,
    import_drive,
    omnidirectional,
    runs_of,
    steps,
    tricycle,
)
from rover_hil.recording.reader import LogReader

Array = NDArray[np.float64]
GYRO_NOISE_RAD_S = 0.005
GYRO = '[imu]\nyaw_rate = { column = "gyro" }\n'
CHI2_95 = 5.991
STRENGTHS = {"last third": 2 / 3, "last two thirds": 1 / 3, "all": 0.0}

Wrong = Callable[[str, Array, NDArray[np.bool_]], Array]
"""From the name of a column, its numbers, and the rows in which it is wrong, to what the table says."""


def with_gyro(drive: Measured) -> Measured:
    """Return a drive with a gyro, and without its truth in the file of columns."""
    sections = drive.sections.replace(TRUTH, "")
    if "gyro" in drive.columns:
        return drive
    turn, elapsed_s = steps(np.unwrap(drive.columns["yaw"])), steps(drive.columns["t"])
    elapsed_s[0] = elapsed_s[1]
    # The truth scatters from row to row: its mean over a quarter of a second is the turn.
    rate = np.convolve(turn / elapsed_s, np.ones(5) / 5, "same")
    noise = np.random.default_rng(3).normal(0.0, GYRO_NOISE_RAD_S, len(rate))
    return replace(drive, columns={**drive.columns, "gyro": rate + noise}, sections=sections + GYRO)


def of_gyro(change: Callable[[Array], Array]) -> Wrong:
    """Return a fault of the gyro."""
    return lambda name, values, wrong: np.where(wrong, change(values), values) if name == "gyro" else values


def of_wheels(change: Callable[[Array], Array], *names: str) -> Wrong:
    """Return a fault of the motion of wheels: of the steps of their angles, or of their speeds."""

    def make(name: str, values: Array, wrong: NDArray[np.bool_]) -> Array:
        if name not in names:
            return values
        moved = steps(values)
        turned: Array = values[0] + np.cumsum(np.where(wrong, change(moved), moved))
        return turned

    return make


def held(values: Array) -> Array:
    """Return readings that repeat the one in the middle."""
    return np.full_like(values, values[len(values) // 2])


def every_second_zero(values: Array) -> Array:
    """Return readings of which every second is zero."""
    return values * (np.arange(len(values)) % 2)


def late(values: Array) -> Array:
    """Return readings that come twenty rows later."""
    return np.concatenate((np.full(20, values[0]), values[:-20]))


KINDS: Mapping[str, Wrong] = {
    "gyro with the wrong sign": of_gyro(lambda values: -values),
    "gyro in deg/s": of_gyro(lambda values: math.degrees(1.0) * values),
    "gyro scaled by 0.12": of_gyro(lambda values: 0.12 * values),
    "every second reading zero": of_gyro(every_second_zero),
    "gyro stuck": of_gyro(held),
    "gyro 20 rows late": of_gyro(late),
    "gyro with an offset of 0.3 rad/s": of_gyro(lambda values: values + 0.3),
    "one encoder reversed": of_wheels(lambda moved: -moved, "w0"),
    "encoders exchanged": of_wheels(lambda moved: moved, "w0"),
    "encoders dead": of_wheels(np.zeros_like, "w0", "w1", "w2"),
    "one encoder dead": of_wheels(np.zeros_like, "w0"),
    "one encoder counts half": of_wheels(lambda moved: 0.5 * moved, "w0"),
}


def spoiled(drive: Measured, kind: str, since: float) -> Measured:
    """Return a drive with a wrong sensor from a share of its time on."""
    t_s = drive.columns["t"]
    wrong = t_s - t_s[0] >= since * (t_s[-1] - t_s[0])
    columns = dict(drive.columns)
    if kind == "encoders exchanged":
        moved = [steps(columns[name]) for name in ("w0", "w1")]
        for name, own, neighbour in zip(("w0", "w1"), moved, moved[::-1], strict=True):
            columns[name] = columns[name][0] + np.cumsum(np.where(wrong, neighbour, own))
    else:
        columns = {name: KINDS[kind](name, values, wrong) for name, values in columns.items()}
    return replace(drive, columns=columns)


def is_inside(log: Path, drive: Measured) -> bool | None:
    """Return whether the 95 % region of the last place contains the true one; None without truth."""
    if "yaw" not in drive.columns:
        return None
    last: dict[str, Any] = {}
    for message in LogReader(log).messages():
        if message.topic == "/estimate":
            last = cast("dict[str, Any]", message.json())["estimate"]
    x, y, yaw = (drive.columns[name] for name in ("x", "y", "yaw"))
    cos, sin = math.cos(yaw[0]), math.sin(yaw[0])
    east, north = x[-1] - x[0], y[-1] - y[0]
    error = np.array(
        (
            last["x_m"] - (cos * east + sin * north),
            last["y_m"] - (cos * north - sin * east),
        )
    )
    xx, xy, _, yy, _, _ = last["covariance"]
    return float(error @ np.linalg.solve(np.array(((xx, xy), (xy, yy))), error)) <= CHI2_95


def main() -> int:
    """Run; returns 1 where a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    makes: dict[str, Callable[[], Measured]] = {
        "diff": lambda: differential(runs_of(options.folder, "diff")[0]),
        "omni3": lambda: omnidirectional(runs_of(options.folder, "omni3")[0]),
        "tricycle": lambda: tricycle(runs_of(options.folder, "tricyc")[0]),
        "car": lambda: car(options.folder),
    }
    named = inside = neither = false = 0
    with TemporaryDirectory() as place:
        folder = Path(place)
        for name, make in makes.items():
            drive = beginning(with_gyro(make()), options.seconds)
            sound = import_drive(drive, folder)
            false += bool(sound.findings)
            print(
                f"{name:9} as it is: {is_inside(folder / 'drive.mcap', drive)} {sound.findings}", flush=True
            )
            for kind in KINDS:
                for strength, since in STRENGTHS.items():
                    is_possible = kind != "encoders exchanged" or "w1" in drive.columns
                    if options.only not in f"{name}/{kind}/{strength}" or not is_possible:
                        continue
                    outcome = import_drive(spoiled(drive, kind, since), folder)
                    said = [*outcome.findings, *filter(None, [outcome.refusal])]
                    holds = None if outcome.refusal else is_inside(folder / "drive.mcap", drive)
                    named += bool(said)
                    inside += not said and holds is True
                    neither += not said and holds is not True
                    verdict = "named" if said else "inside" if holds else "neither"
                    print(
                        f"{name:9} {kind:34} {strength:15} {verdict:8} {(said or [''])[0][:120]}", flush=True
                    )
    print(f"named {named}, region holds the truth {inside}, neither {neither}; sound with a finding {false}")
    return int(neither > 0 or false > 0)


if __name__ == "__main__":
    sys.exit(main())
