"""`rover-hil import rosbag`: a bag becomes a log."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from drivers.clock import seconds
from rover_hil.config import load_config
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ForceOption, JsonOption, out_option
from rover_hil.drives.formats.drive import START_NS
from rover_hil.drives.formats.files import WriteDrive, import_file, print_contents
from rover_hil.drives.formats.limits import EstimateOption, LimitSettings, MemoryOption, TimeOption
from rover_hil.drives.formats.rosbag.to_log import write_bag_as_log
from rover_hil.drives.formats.rosbag.topics import read_topics
from rover_hil.pages.atomic_write import check_new_file, unfinished


def import_bag(
    bag: Annotated[
        Path, typer.Argument(help="A bag of ROS 1 (.bag) or ROS 2 (a folder, .mcap, .db3) of any rover.")
    ],
    *,
    topics_path: Annotated[Path, typer.Option("--topics", help="TOML file: which topic holds what.")],
    out: Annotated[Path, out_option("The log to write.")],
    force: ForceOption = False,
    as_json: JsonOption = False,
    most_memory_gb: MemoryOption = None,
    most_minutes: TimeOption = None,
    no_estimate: EstimateOption = False,
) -> int:
    """Turn a bag of ROS 1 or ROS 2 into a log, which replays exactly.

    Wheels or odometry, angular rates, currents, true poses and compressed pictures are used.

    Example: `rover-hil import rosbag first_rosbag2 --topics topics.toml --out first.mcap`

    Data: `rover-hil sample bag` writes the bag and the file of topics; for yours,
    docs/how-to/import_a_bag.md names the keys.
    """
    check_new_file(out, force=force)

    def make_write() -> WriteDrive:
        topics = read_topics(topics_path)
        rover = load_config(topics.rover)
        return lambda file, part: write_bag_as_log(file, topics, rover, part, with_estimate=not no_estimate)

    with unfinished(out) as part:
        contents = import_file(bag, part, make_write, LimitSettings(most_memory_gb, most_minutes))
    duration_s = seconds(contents.end_ns - START_NS)
    if as_json:
        print_json({"log": str(out), "duration_s": duration_s, **asdict(contents)})
        return EXIT_OK
    print_contents(contents, out, what="messages")
    return EXIT_OK
