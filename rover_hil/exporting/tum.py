"""Write the trajectories of a log as TUM files, which evo reads."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import LogError
from rover_hil.drives.position_frame import PositionFrame, position_frame
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import ESTIMATE, ESTIMATE_SHAPE, TRUTH, TRUTH_SHAPE, PoseRecord, TruthRecord

SUFFIX = ".tum"
ESTIMATED, ODOMETRY, GROUND_TRUTH = "estimate", "odometry", "ground_truth"
CONTENT = {
    ESTIMATED: "estimate of the filter",
    ODOMETRY: "plain odometry: the wheels alone, without slip compensation and gyro",
    GROUND_TRUTH: "ground truth",
}
"""Names of the files, and what they hold."""
COLUMNS = "timestamp x y z qx qy qz qw: s since 1970, m"
OWN_FRAME = "its own, as recorded; compare with evo_ape tum -a"
NO_YAW = "no yaw was recorded: compare positions only, not rotations"

Row: TypeAlias = tuple[int, float, float, float]
"""Wall-clock time in ns since 1970; x and y in m; yaw in rad."""


def tum_texts(
    log: LogReader, on_message: Callable[[], None] = lambda: None
) -> tuple[Mapping[str, str], Mapping[str, int]]:
    """Return TUM files of estimate, plain odometry and, where the log has it, ground truth.

    Estimate and odometry are in the frame of the positions where the log has positions that show it, else in
    that of the pose at start. A row of the estimate has the time of the wheel positions behind it. Ground
    truth without yaw has that of 0.

    Args:
        log: The log.
        on_message: Called after each message, to show progress.

    Returns:
        The texts by the name of the file, and the numbers of their poses by the name of the trajectory.

    Raises:
        LogError: The log is damaged, or has no estimate.
    """
    rows: dict[str, list[Row]] = {name: [] for name in CONTENT}
    has_yaw = True
    for message in log.stored_messages():
        if message.topic == ESTIMATE:
            record = log.parse(message, ESTIMATE_SHAPE)
            time_ns = log.wall_offset_ns + record["estimate"]["t_ns"]
            _add(rows[ESTIMATED], time_ns, record["estimate"])
            _add(rows[ODOMETRY], time_ns, record["odometry"])
        elif message.topic == TRUTH:
            truth = log.parse(message, TRUTH_SHAPE)
            has_yaw = has_yaw and "yaw_rad" in truth
            if truth.get("is_new", True):
                _add(rows[GROUND_TRUTH], log.wall_offset_ns + truth["t_ns"], truth)
        on_message()
    if not rows[ESTIMATED]:
        raise LogError(
            f"log {log.path} holds no estimate: `rover-hil replay {log.path} --out FOLDER` writes a log "
            "with it"
        )
    frame = position_frame(log.path)
    texts = {}
    for name, found in rows.items():
        if found:
            is_truth = name == GROUND_TRUTH
            notes = [COLUMNS, f"{log.path.name}: {CONTENT[name]}"]
            notes.append(f"frame: {OWN_FRAME if is_truth else _frame_words(frame)}")
            notes += [NO_YAW] if is_truth and not has_yaw else []
            placed = found if is_truth or frame is None else _placed(found, frame)
            lines = (*(f"# {note}" for note in notes), *map(_line, placed))
            texts[f"{name}{SUFFIX}"] = "\n".join(lines) + "\n"
    return texts, {name: len(found) for name, found in rows.items() if found}


def _add(rows: list[Row], time_ns: int, pose: PoseRecord | TruthRecord) -> None:
    """Add a pose that is newer than the last one, and finite."""
    row = time_ns, pose["x_m"], pose["y_m"], pose.get("yaw_rad", 0.0)
    if (not rows or time_ns > rows[-1][0]) and math.isfinite(sum(row[1:])):
        rows.append(row)


def _placed(rows: Sequence[Row], frame: PositionFrame) -> list[Row]:
    # Without the times: as floats they would lose their last digits.
    places = frame.place(np.array([(0.0, *row[1:]) for row in rows])).tolist()
    return [(row[0], x, y, yaw) for row, (_, x, y, yaw) in zip(rows, places, strict=True)]


def _frame_words(frame: PositionFrame | None) -> str:
    if frame is None:
        return "that of the pose at start; the log has no positions that show another one"
    return (
        f"that of the {frame.count} positions of {frame.device}, as recorded (of a GNSS receiver: x east, y "
        f"north); turned by {math.degrees(frame.turned_rad):.2f} deg, standard deviation "
        f"{math.degrees(frame.turned_sd_rad):.2f} by the noise of the positions"
    )


def _line(row: Row) -> str:
    time_ns, x_m, y_m, yaw_rad = row
    whole_s, rest_ns = divmod(time_ns, NANOSECONDS_PER_SECOND)
    z, w = math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)
    return f"{whole_s}.{rest_ns:09d} {x_m:.6f} {y_m:.6f} 0 0 0 {z:.9f} {w:.9f}"
