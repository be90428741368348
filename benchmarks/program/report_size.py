"""Size of the report of a long run, and how long it takes: the virtual Robotino on a large rectangle.

    python -m benchmarks.program.report_size [--seconds 420]

`--camera` runs the four-wheel rover with its rear camera instead, for at most its mission.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from drivers.clock import SystemClock, seconds
from rover_hil.config import Config, load_config
from rover_hil.report.write import REPORT_NAME, write_report
from rover_hil.run.driving import run_virtual

BAR_MB = 5.0
LARGE = {"length_m": 12.0, "width_m": 12.0, "speed_m_s": 0.1}


def main() -> int:
    """Print duration and size; exit code 1 when the page is larger than the bar."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=420.0)
    parser.add_argument("--camera", action="store_true")
    arguments = parser.parse_args()
    table = load_config("el-dorado" if arguments.camera else "robotino").model_dump(by_alias=True)
    if not arguments.camera:
        table["mission"].update(LARGE)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        result = run_virtual(Config.model_validate(table), folder / "run.mcap", arguments.seconds, None)
        clock = SystemClock()
        begun_ns = clock.now_ns()
        write_report(folder / "run.mcap", folder)
        taken_s = seconds(clock.now_ns() - begun_ns)
        size_mb = (folder / REPORT_NAME).stat().st_size / 1e6
    print(
        f"report of {result.duration_s:.0f} s: {size_mb:.2f} MB of {BAR_MB:g} MB, written in {taken_s:.1f} s"
    )
    return 0 if size_mb <= BAR_MB else 1


if __name__ == "__main__":
    sys.exit(main())
