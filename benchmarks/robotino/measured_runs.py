"""Measured Robotino runs through the whole path, from bytes to report: how far do wheels and camera differ?

    python -m benchmarks.robotino.measured_runs ../shared/data/robotino_2023 [--every 6] [--picture FILE.png]

Each run (BrOleg5/research-wheel-slippage) is encoded into board frames, decoded, estimated, logged and read
back. The slip ratio, 1 - camera distance / encoder distance at 1.84 mm per pixel, is averaged per surface.
The peer takes the ticks and pixels of the last line of the CSV alone, without driver, estimator or log.
"""

import argparse
import csv
import gzip
import json
import math
import statistics
import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg

from rover_hil.config import Config, load_config
from rover_hil.drives.formats.robotino_csv import read_run
from rover_hil.drives.formats.to_log import observing_config, write_run_as_log
from rover_hil.pages import style
from rover_hil.report.figures.pose import draw_path
from rover_hil.report.read_run import read_run as read_log
from rover_hil.report.summary import summarise

MILLIMETRES_PER_PIXEL = 1.84
RADIANS_PER_TICK = 2 * math.pi / 2000 / 16
WHEEL_RADIUS_M = 0.040


def slip_ratio(csv_path: Path, log_path: Path, config: Config) -> float | None:
    """Return the slip ratio of one run as the report has it."""
    for _ in write_run_as_log(read_run(csv_path, MILLIMETRES_PER_PIXEL), csv_path.name, config, log_path):
        pass
    return summarise(read_log(log_path)).slip_ratio


def plain_slip_ratio(csv_path: Path) -> float:
    """Return the slip ratio of one run from the displacements alone."""
    with gzip.open(csv_path, "rt", encoding="utf-8") as stream:
        lines = list(csv.DictReader(list(stream)[2:], delimiter=";"))
    first, last = lines[0], lines[-1]
    m1, m2, m3 = (
        (float(last[name]) - float(first[name])) * RADIANS_PER_TICK * WHEEL_RADIUS_M
        for name in ("m1pos", "m2pos", "m3pos")
    )
    encoders_m = math.hypot((m3 - m1) / math.sqrt(3), (m1 + m3 - 2 * m2) / 3)
    camera_m = math.hypot(*(float(last[name]) - float(first[name]) for name in ("xpos", "ypos")))
    return 1 - camera_m * MILLIMETRES_PER_PIXEL / 1000 / encoders_m


def write_picture(csv_path: Path, log_path: Path, config: Config, picture: Path) -> None:
    """Draw the path of one run as the report does."""
    slip_ratio(csv_path, log_path, config)
    run = read_log(log_path)
    with mpl.rc_context(style.STYLE):
        figure = draw_path(run, summarise(run))
        FigureCanvasAgg(figure).print_figure(picture, dpi=120)


def main() -> int:
    """Print the figures as JSON; exit code 1 when path and peer differ by more than 0.02 on average."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--every", type=int, default=6)
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    config = observing_config(load_config("robotino"))
    rows: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        surfaces = sorted((arguments.data / "one_surface_type").glob("*_surface"))
        for surface in surfaces:
            ratios: list[float] = []
            plain: list[float] = []
            for csv_path in sorted(surface.glob("*.csv.gz"))[:: arguments.every]:
                ratio = slip_ratio(csv_path, folder / f"{surface.name}-{csv_path.stem}.mcap", config)
                if ratio is not None:
                    ratios.append(ratio)
                    plain.append(plain_slip_ratio(csv_path))
            rows[surface.name] = {
                "runs": len(ratios),
                "slip_ratio": round(statistics.mean(ratios), 3),
                "peer_slip_ratio": round(statistics.mean(plain), 3),
            }
        if arguments.picture is not None:
            gray = arguments.data / "one_surface_type" / "gray_surface" / "exp00.csv.gz"
            write_picture(gray, folder / "picture.mcap", config, arguments.picture)
    print(json.dumps(rows, indent=2))
    return 0 if all(abs(row["slip_ratio"] - row["peer_slip_ratio"]) <= 0.02 for row in rows.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
