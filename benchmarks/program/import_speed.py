"""How much processor time does the import of an hour of a steered rover take?

    python -m benchmarks.program.import_speed [--rows 180000] [--only steered ...]

Tables with 50 rows/s of rovers that drive curves and stand are made and imported by the command. All have a
gyro, and 5 GNSS positions/s. Noise is on every number, so that no two rows have the same steering angle.

    unsteered    two fixed wheels
    steered      the same, and in front a steered wheel without an encoder
    four_wheels  a car: four measured wheels, the two in front are steered
    truth        as steered, with ground truth in every row

Prints JSON lines: processor time in all and per row, with the estimate and without, and how many times that
of a peer in the same run: a loop that reads the same table with the csv module and writes each row as JSON.
The peer runs before and after each import, so that the load of the computer counts for both. Exit code 1
where an import fails.
"""

import argparse
import csv
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

PROGRAM = (sys.executable, "-c", "from rover_hil.app.program import main; main()")
RATE_HZ, GNSS_EVERY = 50, 10
RADIUS_M, BASE_M, HALF_TRACK_M = 0.15, 0.9, 0.3
LATITUDE_DEG, LONGITUDE_DEG, METRES_PER_DEG = 49.0, 8.0, 111_200.0
NOISE = {"position": 2e-4, "steering": 2e-3, "gyro": 2e-3, "gnss_m": 0.3}
KINDS = ("unsteered", "steered", "four_wheels", "truth")
STEERS = ", steering = { low_deg = -40, high_deg = 40, rate_deg_s = 120 }"
LIMITS = "[limits]\nwheel_speed_rad_s = 40\nwheel_acceleration_rad_s2 = 200\n"
SENSORS = """[imu]
yaw_rate = { column = "gyro" }

[fixes]
latitude = { column = "latitude" }
longitude = { column = "longitude" }
sigma_m = 0.3
"""
TRUTH = '\n[truth]\nx = { column = "x" }\ny = { column = "y" }\nyaw = { column = "yaw" }\n'


def write_drive(folder: Path, kind: str, rows: int) -> list[str]:
    """Write the table of a drive and the file of its columns; return the words that import it."""
    random = np.random.default_rng(7)
    t_s = np.arange(rows) / RATE_HZ
    # It stands 4 s of each 40 s.
    speed_m_s = np.where(t_s % 40.0 < 4.0, 0.0, 1.2 + 0.3 * np.sin(0.37 * t_s))
    steering_rad = 0.35 * np.sin(0.21 * t_s) + 0.1 * np.sin(1.3 * t_s)
    rate_rad_s = speed_m_s * np.tan(steering_rad) / BASE_M
    yaw_rad = np.cumsum(rate_rad_s) / RATE_HZ
    x_m, y_m = (np.cumsum(speed_m_s * part) / RATE_HZ for part in (np.cos(yaw_rad), np.sin(yaw_rad)))
    front_m = (BASE_M, HALF_TRACK_M), (BASE_M, -HALF_TRACK_M)
    rear_m = (0.0, HALF_TRACK_M), (0.0, -HALF_TRACK_M)
    places = (*front_m, *rear_m) if kind == "four_wheels" else rear_m
    columns, wheels, sections = {"t": t_s}, [], ['[time]\ncolumn = "t"\n']
    for number, (at_x_m, at_y_m) in enumerate(places):
        along_m_s, aside_m_s = speed_m_s - rate_rad_s * at_y_m, rate_rad_s * at_x_m
        turned_rad = np.cumsum(np.hypot(along_m_s, aside_m_s)) / RATE_HZ / RADIUS_M
        columns[f"w{number}"] = turned_rad + random.normal(0.0, NOISE["position"], rows)
        section = f'[[wheel]]\nposition = {{ column = "w{number}", unit = "rad" }}\n'
        if at_x_m:
            angle_rad = np.arctan2(np.tan(steering_rad) * at_x_m, BASE_M - np.tan(steering_rad) * at_y_m)
            columns[f"s{number}"] = angle_rad + random.normal(0.0, NOISE["steering"], rows)
            section += f'steering = {{ column = "s{number}", unit = "rad" }}\n'
        sections.append(section)
        steers = STEERS if at_x_m else ""
        wheels.append(f"{{ x_m = {at_x_m}, y_m = {at_y_m}, radius_m = {RADIUS_M}{steers} }}")
    if kind in ("steered", "truth"):
        columns["steering"] = steering_rad + random.normal(0.0, NOISE["steering"], rows)
        sections.append('[[wheel]]\nsteering = { column = "steering", unit = "rad" }\n')
        front = f"x_m = {BASE_M}, y_m = 0.0, radius_m = {RADIUS_M}, driven = false, measured = false"
        wheels.append(f"{{ {front}{STEERS} }}")
    columns["gyro"] = rate_rad_s + 0.01 + random.normal(0.0, NOISE["gyro"], rows)
    east_m, north_m = (path + random.normal(0.0, NOISE["gnss_m"], rows) for path in (x_m, y_m))
    is_fix = np.arange(rows) % GNSS_EVERY == 0
    degrees = METRES_PER_DEG * np.cos(np.radians(LATITUDE_DEG))
    columns["latitude"] = np.where(is_fix, LATITUDE_DEG + north_m / METRES_PER_DEG, np.nan)
    columns["longitude"] = np.where(is_fix, LONGITUDE_DEG + east_m / degrees, np.nan)
    text = "\n".join([*sections, SENSORS])
    if kind == "truth":
        columns |= {"x": x_m, "y": y_m, "yaw": yaw_rad}
        text += TRUTH
    listed = "\n".join(f"  {wheel}," for wheel in wheels)
    text += f'\n[rover]\nkinematics = "wheels"\nwheels = [\n{listed}\n]\n{LIMITS}'
    (folder / "columns.toml").write_text(text, "utf-8")
    pd.DataFrame(columns).round(8).to_csv(folder / "drive.csv", index=False)
    return ["import", "table", "drive.csv", "--columns", "columns.toml", "--out", "drive.mcap"]


def processor_s(folder: Path, words: list[str]) -> tuple[float, str]:
    """Run a command; return its processor time and what went wrong, or nothing."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([*PROGRAM, *words], cwd=folder, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return used_s, "" if done.returncode == 0 else done.stderr or done.stdout


def peer_s(folder: Path) -> float:
    """Return the processor time of the peer."""
    started_s = time.process_time()
    with (
        (folder / "drive.csv").open(encoding="utf-8", newline="") as table,
        (folder / "rows.json").open("w", encoding="utf-8") as rows,
    ):
        for row in csv.DictReader(table):
            rows.write(json.dumps({key: float(value or "nan") for key, value in row.items()}))
    return time.process_time() - started_s


def measure(kind: str, rows: int) -> dict[str, object]:
    """Import the drive of a rover in each way; return the figures."""
    result: dict[str, object] = {"kind": kind, "rows": rows}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = write_drive(folder, kind, rows)
        ways: tuple[tuple[str, list[str]], ...] = (("estimate", []), ("no_estimate", ["--no-estimate"]))
        for way, options in ways:
            before_s = peer_s(folder)
            used_s, failure = processor_s(folder, [*words, "--force", *options])
            times = 2.0 * used_s / (before_s + peer_s(folder))
            result |= {
                f"{way}_s": round(used_s, 1),
                f"{way}_us_per_row": round(1e6 * used_s / rows),
                f"{way}_times_peer": round(times, 1),
            }
            if failure:
                result[f"{way}_failure"] = failure
    return result


def main() -> int:
    """Print the figures; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", type=int, default=3600 * RATE_HZ)
    parser.add_argument("--only", nargs="+", choices=KINDS, default=KINDS)
    options = parser.parse_args()
    failed = False
    for kind in options.only:
        result = measure(kind, options.rows)
        failed |= any(key.endswith("failure") for key in result)
        print(json.dumps(result), flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
