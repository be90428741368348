"""`rover-hil gap rover` on the circles of measured robots, beside the reference fit of their trajectories.

    python -m benchmarks.gap.measured_rovers DATA [--runs 6] [--robot diff]

DATA holds `diff`, `omni3` and `tricyc` of the optiodom recordings. The reference was fitted and stored before
the first comparison (`benchmarks.gap.reference_rovers`). The rear wheels of the tricycle have neither a motor
nor a sensor.
"""

import argparse
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.gap.drive_logs import write_log as write_drive
from benchmarks.gap.reference_rovers import Array, read_run
from benchmarks.gap.rover_of_wheels import ROOT, verdict_of
from rover_hil.config import Config, load_config
from tests.nature.differential_drive import Recorded

REFERENCE = Path(__file__).parent / "references" / "optiodom_circles.json"
RADII_M = {"diff": 0.042, "omni3": 0.051, "tricyc": 0.0325}
TICKS = {"diff": 43.7 * 64.0, "omni3": 12.0 * 1024.0, "tricyc": 1600.0}
MASSES_KG = {"diff": 3.0, "omni3": 8.0, "tricyc": 3.0}


MOTOR = "{ stall_torque_nm = 4.0, no_load_rad_s = 20.0, stall_current_a = 8.0 }"


def wheels_of(robot: str) -> list[dict[str, float | str]]:
    """Return the wheels by the data sheet, in the order of the ticks; then those without a sensor."""
    if robot == "diff":
        return [{"x_m": 0.0, "y_m": -0.1, "motor": MOTOR}, {"x_m": 0.0, "y_m": 0.1, "motor": MOTOR}]
    if robot == "tricyc":
        front: dict[str, float | str] = {
            "x_m": 0.15,
            "y_m": 0.0,
            "steering": "{ low_deg = -90.0, high_deg = 90.0 }",
            "motor": MOTOR,
        }
        # How far apart the rear wheels are is not published, and does not matter: they share an axle.
        left: dict[str, float | str] = {"x_m": 0.0, "y_m": 0.08, "driven": "false"}
        return [front, left, {**left, "y_m": -0.08}]
    found: list[dict[str, float | str]] = []
    for angle_deg in (210.0, -30.0, 90.0):
        angle = np.radians(angle_deg)
        place = {"x_m": float(-0.195 * np.sin(angle)), "y_m": float(0.195 * np.cos(angle))}
        found.append({**place, "angle_deg": angle_deg, "roller_deg": 90.0, "motor": MOTOR})
    return found


def config_text(robot: str) -> str:
    """Return the configuration of a robot: that of the differential example with other wheels."""
    text = (ROOT / "docs/examples/differential.toml").read_text("utf-8")
    head, tail = text[: text.index("[[rover.wheels]]")], text[text.index("[loop]") :]
    lines = []
    for wheel in wheels_of(robot):
        keys = {**wheel, "radius_m": RADII_M[robot]}
        lines.append("[[rover.wheels]]")
        lines += [
            f"{name} = {value}" if isinstance(value, str) else f"{name} = {value:.6f}"
            for name, value in keys.items()
        ]
    tail = tail.replace("mass_kg = 8.0", f"mass_kg = {MASSES_KG[robot]}")
    if robot != "diff":
        tail = tail[: tail.index("[[simulation.plant.castors]]")].replace(
            "centre_of_mass_x_m = -0.03", f"centre_of_mass_x_m = {0.05 if robot == 'tricyc' else 0.0}"
        )
        tail = tail.replace("can/differential.toml", "can/mecanum.toml")
    return head + "\n".join(lines) + "\n\n" + tail


def write_log(path: Path, config: Config, run: Array, robot: str) -> None:
    """Write a recorded drive as a log, the motion capture on /truth."""
    is_steered = robot == "tricyc"
    turned = np.cumsum(run[:, 4:5] if is_steered else run[:, 4:], axis=0)
    drive = Recorded(
        t_s=run[:, 0],
        wheels_rad=turned * 2.0 * np.pi / TICKS[robot],
        gyro_rad_s=np.full(len(run), np.nan),
        pose=np.column_stack((run[:, 1:3], np.unwrap(run[:, 3]))),
    )
    write_drive(path, config, drive, steering_rad=run[:, 5:6] if is_steered else None)


def main() -> None:
    """Print the verdicts and the reference."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--robot", choices=sorted(RADII_M), help="one of them only")
    arguments = parser.parse_args()
    data = arguments.data.resolve()
    os.chdir(ROOT)
    reference = json.loads(REFERENCE.read_text("utf-8"))
    for robot, radius_m in RADII_M.items():
        if arguments.robot not in (None, robot):
            continue
        text = config_text(robot)
        file = Path(tempfile.gettempdir()) / f"measured_{robot}.toml"
        file.write_text(text, "utf-8")
        config = load_config(str(file))
        files = sorted(one for one in (data / robot).rglob("*_run-??.csv.gz"))
        chosen = np.unique(
            np.linspace(0, len(files) - 1, min(len(files), arguments.runs)).round().astype(int)
        )
        runs = iter([read_run(files[index]) for index in chosen])

        def write(
            path: Path, config: Config = config, runs: Iterator[Array] = runs, robot: str = robot
        ) -> None:
            write_log(path, config, next(runs), robot)

        verdict = verdict_of(text, write, len(chosen))
        print(f"\n{robot}, {len(chosen)} runs, {verdict['seconds']:.0f} s: {verdict['verdict']}")
        print(verdict["sentence"])
        print(json.dumps(verdict["effects"]))
        for one in verdict.get("base_parameters", []):
            low, high = one["ci95"]
            print(
                f"  {one['name']} {one['value']:.5f} ({low:.5f} to {high:.5f}), pull {one['pull']:+.1f}"
                f"{', named' if one['is_named'] else ''} {one['why']}"
            )
        for name, row in reference[robot]["parameters"].items():
            share = f", {row['value'] / radius_m - 1.0:+.4f}" if name.startswith("radius") else ""
            print(f"  reference {name} {row['value']:.5f} ({row['low']:.5f} to {row['high']:.5f}){share}")


if __name__ == "__main__":
    main()
