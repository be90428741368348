"""`rover-hil import rosbag`: a bag becomes a log."""

from dataclasses import asdict
from pathlib import Path

from drivers.clock import seconds
from rover_hil.app.import_contents import add_truth_findings, print_contents
from rover_hil.config import load_config
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.steps import show_steps
from rover_hil.importing.drive import START_NS, Contents
from rover_hil.importing.rosbag.bag import bounded_memory
from rover_hil.importing.rosbag.to_log import write_bag_as_log
from rover_hil.importing.rosbag.topics import read_topics
from rover_hil.pages.atomic_write import check_file, unfinished


def import_bag(path: Path, *, topics_path: Path, out: Path, force: bool, as_json: bool) -> int:
    """Turn a bag into the log `out`; returns the exit code.

    Raises:
        ConfigError: The file of topics or the rover is wrong, or `out` exists or cannot be written.
        LogError: The bag cannot be read, or does not fit the topics.
    """
    check_file(out, force=force)
    topics = read_topics(topics_path)
    rover = load_config(topics.rover)
    contents = Contents()
    with unfinished(out) as part, show_steps("looking at the bag") as step, bounded_memory():
        for contents in write_bag_as_log(path, topics, rover, part):
            step(f"importing, {seconds(contents.end_ns - START_NS):.0f} s of the bag are done")
        add_truth_findings(contents, part)
    duration_s = seconds(contents.end_ns - START_NS)
    if as_json:
        print_json({"log": str(out), "duration_s": duration_s, **asdict(contents)})
        return EXIT_OK
    print_contents(contents, out, what="messages")
    return EXIT_OK
