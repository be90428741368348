"""The pictures of README: the bench page when a fault has stopped the rover, and the report of that run.

    python -m benchmarks.program.pictures docs/images

Writes `bench.png` and `report.png`. The rover is the simulated Robotino on slippery ground; the board with
its encoders is unplugged for two seconds. Needs the extra `bench`, selenium, chromium and chromedriver.
"""

import argparse
import io
import tempfile
from pathlib import Path

from PIL import Image

from tests.rover_hil.bench.browser import CONFIG, Page, served, write_config

PAGE_PX = (1200, 1000)
REPORT_PX = (1000, 900)
WIDTH_PX = 800
COLOURS = 128
FAULT = """
[[simulation.faults]]
device = "board"
type = "unplug"
start_s = 12
duration_s = 2
"""
STATE = "return live.state.state"


def save(page: Page, path: Path) -> None:
    """Save what the window shows, and print the size of the file."""
    picture = Image.open(io.BytesIO(page.driver.get_screenshot_as_png())).convert("RGB")
    height_px = round(picture.height * WIDTH_PX / picture.width)
    picture = picture.resize((WIDTH_PX, height_px), Image.Resampling.LANCZOS)
    picture.quantize(COLOURS).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    out: Path = parser.parse_args().folder
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_config(folder)
        with (folder / CONFIG).open("a") as file:
            file.write(FAULT)
        with served(folder) as (url, _), Page(url) as page:
            page.driver.set_window_size(*PAGE_PX)
            page.click("Start mission")
            page.wait(lambda: page.driver.execute_script(STATE) == "running", "the run does not start")
            page.wait(lambda: page.driver.execute_script(STATE) != "running", "the run does not end")
            save(page, out / "bench.png")
            page.wait(lambda: page.driver.execute_script(STATE) == "idle", "no report")
            (report,) = folder.glob("runs/*/report.html")
            page.driver.set_window_size(*REPORT_PX)
            page.driver.get(report.as_uri())
            save(page, out / "report.png")


if __name__ == "__main__":
    main()
