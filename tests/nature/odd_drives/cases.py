"""The faulty drives: for each its kit, its fault, the one true cause, and the words that report it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from tests.nature.odd_drives import faults
from tests.nature.odd_drives.bag import Bag, record_bag
from tests.nature.odd_drives.can_log import CanKit, CanLog, candump_delta, record_can, savvycan
from tests.nature.odd_drives.faults import Fault
from tests.nature.odd_drives.motion import CAR, FOUR, LARGE, OMNI, SMALL, Drive, Leg, Rover, drive, tour
from tests.nature.odd_drives.table import Kit, record


class Recording(Protocol):
    """What is written into the folder of a case."""

    def write(self, folder: Path) -> list[str]:
        """Write all files. Return the arguments of the import."""
        ...


Make = Callable[[np.random.Generator], tuple[Drive, Recording]]


@dataclass(frozen=True, kw_only=True)
class Case:
    """One drive and the right answer."""

    name: str
    group: str
    cause: str
    make: Make
    words: tuple[str, ...] = ()
    not_words: tuple[str, ...] = ()
    decidable: bool = True
    silent_is_right: bool = False
    """The right drive without a finding is right, too."""


def in_table(
    rover: Rover,
    kit: Kit | None = None,
    fault: Fault | None = None,
    *,
    seconds: float = 40.0,
    back: bool = False,
    legs: Callable[[np.random.Generator], list[Leg]] | None = None,
    slip: float | None = None,
    skip_s: float = 0.0,
) -> Make:
    """Return the maker of a table."""

    def make(rng: np.random.Generator) -> tuple[Drive, Recording]:
        plan = legs(rng) if legs else tour(rover, rng, seconds=seconds, back=back)
        driven = drive(rover, plan, rng, slip=slip, skip_s=skip_s)
        table = record(driven, kit or Kit(), rng)
        if fault:
            fault(table, driven, rng)
        return driven, table

    return make


def in_can(
    rover: Rover,
    kit: CanKit | None = None,
    change: Callable[[CanLog], None] | None = None,
    *,
    seconds: float = 35.0,
) -> Make:
    """Return the maker of a CAN log."""

    def make(rng: np.random.Generator) -> tuple[Drive, Recording]:
        driven = drive(rover, tour(rover, rng, seconds=seconds), rng)
        log = record_can(driven, kit or CanKit(), rng)
        if change:
            change(log)
        return driven, log

    return make


def in_bag(change: Callable[[Bag], None] | None = None, *, seconds: float = 35.0) -> Make:
    """Return the maker of a bag."""

    def make(rng: np.random.Generator) -> tuple[Drive, Recording]:
        driven = drive(SMALL, tour(SMALL, rng, seconds=seconds, back=True), rng)
        bag = record_bag(driven, rng)
        if change:
            change(bag)
        return driven, bag

    return make


POSE = Kit(truth="pose")
GYROLESS = Kit(gyro=False)
SPEED = Kit(wheels="speed")
ROAD = Kit(wheels="speed", fixes="geodetic", fix_sigma_m=0.3, fix_correlation_s=2.0)
RTK = Kit(fixes="geodetic", fix_sigma_m=0.02)

GYRO = r"(gyro|imu|yaw rate).*(sign|revers|scale|unit|stuck|wrong|axis|jumped|follows|no signal)"
WHEEL = r"wheel.*(revers|exchang|swap|interchang|wrong sign)|ticks_per_turn|gear_ratio|\bradius\b|\btrack\b"
CLOCK = r"\bclock|\btimes?tamps? |time runs back"
TIME_UNIT = (
    r"\b(milli|micro|nano)-?seconds?\b",
    r"unit of (the )?time",
    r"\btimes?\b.*\bunit",
    r"\bclock\b.*\b(unit|factor)",
)
SET_BACK = (r"set back", r"(runs?|jumps?|steps?|goes|went) back", r"backwards? in time", r"\bclock.*\bback")
AHEAD = (r"clock.*(set|jump|step|ahead|forward)", r"times? (jump|step|leap)\w*", r"set (ahead|forward)")
WRAP = (r"\bwraps?\b", r"begins? anew", r"starts? again", r"overflow", r"2\^(32|16)", r"(32|16).bit")
ONE_TIME = (
    r"(one|same|equal|identical|repeated) (time|stamp)",
    r"coarse",
    r"resolution of the (clock|time)",
    r"whole second",
)
TWO_CLOCKS = (
    r"two clocks",
    r"(other|another|different|second|own) clock",
    r"clocks? (of|differ)",
    r"not (of )?(one|the same) clock",
)
BEFORE = (r"before 1970", r"negative time", r"clock.*not set", r"unset clock")
ZERO = (
    r"\btimes? (of )?(is )?0\b",
    r"\b(at|with|t =) (time )?0\b",
    r"zero time",
    r"time (of )?zero",
    r"no time",
)
LATE = (r"\b(late|later|delay|delayed|lags?|offset|behind|early|earlier|shifted|ahead)\b",)
UNSIGNED = (r"no sign\b", r"without (a )?sign", r"unsigned", r"(lost|lack|missing).*sign", r"magnitude")
REVERSED = (
    r"wheel.*(revers|wrong sign|opposite (sign|sense|way|direction)|backwards|sign = -1)",
    r"wheel.*(inverted|counts back)",
    r"(revers|inverted|opposite).*wheel",
)
EXCHANGED = (r"exchang", r"swapp?", r"interchang", r"(wrong|other) order", r"left.*right.*(mixed|wrong)")
GYRO_SIGN = (
    r"(gyro|imu|yaw rate).*(sign|revers|opposite|invert|clockwise)",
    r"(sign|revers|opposite).*(gyro|imu|yaw rate)",
)
GYRO_FACTOR = (
    r"(gyro|imu|yaw rate).*(unit|deg|factor|scale|times|57)",
    r"(unit|deg|factor|scale|57).*(gyro|imu|yaw rate)",
)
WHEEL_FACTOR = (
    r"\bunit\b",
    r"\bfactor\b",
    r"\bticks?\b",
    r"gear",
    r"\brpm\b",
    r"radius",
    r"wheels?.*\btimes (too|as|the|what)",
)
RADIUS = (r"radius|radii|diameter", r"wheels?.*(factor|scale)", r"(factor|scale).*wheels?")
TRACK = (r"\btrack\b", r"base_radius", r"distance (between|of) the wheels", r"wheel ?base|base radius")
RATIO = (r"\bratio\b", r"steering wheel", r"steer.*(factor|scale|unit|too (large|great|much)|times)")
COORDINATES = (
    r"(latitude|longitude).*(exchang|swap|interchang|mixed|order|other)",
    r"(exchang|swap|interchang).*(latitude|longitude)",
)
NULL_ISLAND = (
    r"\b0(\.0)?,? (and )?0(\.0)?\b",
    r"zero.*(position|fix|coordinate|reading)",
    r"(position|fix|coordinate|reading).*\b(zero|0)\b",
)
HELD = (
    r"\bheld\b",
    r"repeat",
    r"10 Hz",
    r"(slower|coarser|lower|less often)",
    r"same (value|reading)",
    r"every (5|fifth)",
)
COARSE = (r"coarse", r"\bsteps?\b", r"resolution", r"quanti[sz]")
ENCODER = (r"wheel.*(stuck|stands|stood|dead|standstill|does not turn|silent|fails|repeat)", r"encoder")

UNITS_OF_TIME = [
    Case(
        name="ms_as_s_small",
        group="clock unit",
        cause="The times are milliseconds, described as s.",
        make=in_table(SMALL, Kit(), faults.scaled_time(1e3, "s", decimals=1)),
        words=(r"\bms\b", *TIME_UNIT),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="ms_as_s_car",
        group="clock unit",
        cause="The times are milliseconds, described as s.",
        make=in_table(CAR, ROAD, faults.scaled_time(1e3, "s", decimals=1)),
        words=(r"\bms\b", *TIME_UNIT),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="ms_as_s_epoch_omni",
        group="clock unit",
        cause="The times are milliseconds since 1970, described as s.",
        make=in_table(OMNI, POSE, faults.scaled_time(1e3, "s", first=1.7e12, decimals=0)),
        words=(r"\bms\b", *TIME_UNIT),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="us_in_ms_four",
        group="clock unit",
        cause="A column named and described as ms holds microseconds.",
        make=in_table(FOUR, POSE, faults.scaled_time(1e6, "ms", decimals=0)),
        words=(r"\b(us|\xb5s)\b", *TIME_UNIT),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="us_in_ms_large_speed",
        group="clock unit",
        cause="A column named and described as ms holds microseconds.",
        make=in_table(LARGE, SPEED, faults.scaled_time(1e6, "ms", first=5e8, decimals=0)),
        words=(r"\b(us|\xb5s)\b", *TIME_UNIT),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="s_as_ms_small",
        group="clock unit",
        cause="The times are seconds, described as ms.",
        make=in_table(SMALL, Kit(), faults.scaled_time(1.0, "ms", decimals=4)),
        words=TIME_UNIT,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="s_as_ms_large_truth",
        group="clock unit",
        cause="The times are seconds, described as ms.",
        make=in_table(
            LARGE, Kit(wheels="speed", gyro=False, truth="pose"), faults.scaled_time(1.0, "ms", decimals=4)
        ),
        words=TIME_UNIT,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="ns_as_us_four",
        group="clock unit",
        cause="The times are nanoseconds, described as us.",
        make=in_table(FOUR, Kit(), faults.stamped(lambda t: f"{7_000_000_000_000 + round(t * 1e9)}", "us")),
        words=(r"\bns\b", *TIME_UNIT),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="days_small",
        group="clock unit",
        cause="The times are days of a spreadsheet, described as s.",
        make=in_table(SMALL, Kit(), faults.stamped(faults.day_fraction, "s")),
        words=(r"\bdays?\b", *TIME_UNIT),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="days_car",
        group="clock unit",
        cause="The times are fractions of a day, described as s.",
        make=in_table(CAR, ROAD, faults.scaled_time(1 / 86400, "s", first=0.4, decimals=10)),
        words=(r"\bdays?\b", *TIME_UNIT),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="whole_seconds_small",
        group="clock unit",
        cause="The times are whole seconds: the fraction was cut off.",
        make=in_table(SMALL, Kit(), faults.stamped(faults.whole_seconds, "s")),
        words=ONE_TIME,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="whole_seconds_omni_truth",
        group="clock unit",
        cause="The times are whole seconds: the fraction was cut off.",
        make=in_table(OMNI, Kit(rate_hz=20.0, truth="pose"), faults.stamped(faults.whole_seconds, "s")),
        words=ONE_TIME,
        not_words=(GYRO, WHEEL),
    ),
]

RELATIVE_WORDS = (
    r"relative",
    r"(since|from|counts?|after) the (row|line|frame|one|message) before",
    r"(difference|interval|step|period)s? (of|between)",
    r"\bdelta\b",
    r"not (a )?times?\b.*(but|step|difference)",
)
CLOCKS = [
    Case(
        name="relative_s_small",
        group="relative times",
        cause="Each time counts from the row before.",
        make=in_table(SMALL, Kit(jitter_s=0.001), faults.relative(1.0, "s")),
        words=RELATIVE_WORDS,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="relative_ms_four",
        group="relative times",
        cause="Each time counts from the row before, in ms.",
        make=in_table(FOUR, POSE, faults.relative(1e3, "ms")),
        words=RELATIVE_WORDS,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="can_delta_small",
        group="relative times",
        cause="candump -t d: each time counts from the frame before.",
        make=in_can(SMALL, change=lambda log: setattr(log, "writer", candump_delta)),
        words=(*RELATIVE_WORDS, r"-t d\b"),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="set_back_2_small",
        group="clock set",
        cause="The clock of the recorder was set back by 2 s in the middle.",
        make=in_table(SMALL, Kit(), faults.clock_set(-2.0, 0.5)),
        words=SET_BACK,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="set_back_hour_large",
        group="clock set",
        cause="The clock was set back by an hour in the middle.",
        make=in_table(LARGE, POSE, faults.clock_set(-3600.0, 0.6, first=1.7e9)),
        words=SET_BACK,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="set_back_half_omni",
        group="clock set",
        cause="The clock was set back by 0.5 s in the middle.",
        make=in_table(OMNI, Kit(), faults.clock_set(-0.5, 0.4, first=1.7e9)),
        words=SET_BACK,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="set_ahead_5_small",
        group="clock set",
        cause="The clock was set ahead by 5 s in motion; no row is missing.",
        make=in_table(SMALL, POSE, faults.clock_set(5.0, 0.5)),
        words=AHEAD,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="set_ahead_hour_four",
        group="clock set",
        cause="The clock was set ahead by an hour in motion; no row is missing.",
        make=in_table(FOUR, Kit(), faults.clock_set(3600.0, 0.5, first=1.7e9)),
        words=AHEAD,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="set_ahead_3_car",
        group="clock set",
        cause="The clock was set ahead by 3 s in motion; no row is missing, as the positions show.",
        make=in_table(CAR, Kit(fixes="geodetic", fix_hz=10.0), faults.clock_set(3.0, 0.5)),
        words=AHEAD,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="can_set_back_small",
        group="clock set",
        cause="The clock of the recorder was set back by 2 s in the middle.",
        make=in_can(SMALL, change=lambda log: _shift_frames(log, -2.0)),
        words=SET_BACK,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="bag_set_back",
        group="clock set",
        cause="The clock of the recorder was set back by 3 s in the middle, not that of the headers.",
        make=in_bag(lambda bag: setattr(bag, "recorder_jump_s", -3.0)),
        words=SET_BACK,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="wrap_us_large",
        group="clock wrap",
        cause="Microseconds in 32 bits wrap.",
        make=in_table(LARGE, Kit(), faults.wraps(32, 1e6, "us", 0.4)),
        words=WRAP,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="wrap_us_omni",
        group="clock wrap",
        cause="Microseconds in 32 bits wrap.",
        make=in_table(OMNI, POSE, faults.wraps(32, 1e6, "us", 0.7)),
        words=WRAP,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="wrap_ms_small",
        group="clock wrap",
        cause="Milliseconds in 16 bits wrap, twice.",
        make=in_table(SMALL, Kit(rate_hz=20.0), faults.wraps(16, 1e3, "ms", 0.2), seconds=95.0),
        words=WRAP,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="wrap_ms_car",
        group="clock wrap",
        cause="Milliseconds in 16 bits wrap.",
        make=in_table(CAR, ROAD, faults.wraps(16, 1e3, "ms", 0.5)),
        words=WRAP,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="can_wrap_savvycan",
        group="clock wrap",
        cause="Microseconds in 32 bits wrap.",
        make=in_can(SMALL, change=lambda log: _savvycan(log, 2**32 - 14_000_000, 32)),
        words=WRAP,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="pairs_large",
        group="rows of one time",
        cause="The clock is coarser than the rows: 40 ms, two rows have one time.",
        make=in_table(LARGE, Kit(), faults.stamped(lambda t: f"{int(t * 25 + 1e-6) / 25:.2f}", "s")),
        words=ONE_TIME,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="tenths_four",
        group="rows of one time",
        cause="The clock is coarser than the rows: tenths of a second, five rows have one time.",
        make=in_table(FOUR, POSE, faults.stamped(lambda t: f"{int(t * 10 + 1e-6) / 10:.1f}", "s")),
        words=ONE_TIME,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="batches_small",
        group="rows of one time",
        cause="Rows arrive in batches of 1 to 4, and all of a batch have the time of the last one.",
        make=in_table(SMALL, Kit(), faults.batches),
        words=(*ONE_TIME, r"batch|burst|at once|buffer"),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="two_clocks_rows_small",
        group="two clocks",
        cause="Rows of the gyro have another clock (since its start) than rows of the wheels (time of day).",
        make=in_table(SMALL, Kit(), faults.interleaved_clocks),
        words=TWO_CLOCKS,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="two_loggers_large",
        group="two clocks",
        cause="Every second row is of a logger whose clock is 40 s ahead.",
        make=in_table(LARGE, POSE, faults.two_loggers),
        words=TWO_CLOCKS,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="truth_local_time_omni",
        group="two clocks",
        cause="The file of the ground truth has another clock: local time, two hours ahead.",
        make=in_table(OMNI, Kit(truth="pose", truth_file=True), faults.truth_clock(7200.0)),
        words=(*TWO_CLOCKS, r"truth.*clock|clock.*truth"),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="truth_leap_seconds_large",
        group="two clocks",
        cause="The file of the ground truth has another clock: GPS time, 18 s ahead of UTC.",
        make=in_table(LARGE, Kit(truth="pose", truth_file=True), faults.truth_clock(18.0), seconds=60.0),
        words=(*TWO_CLOCKS, *LATE, r"truth.*clock|clock.*truth"),
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="before_1970_small",
        group="before 1970",
        cause="Times before 1970: microseconds with a negative offset. The steps are right.",
        make=in_table(SMALL, Kit(), faults.scaled_time(1e6, "us", first=-1.6e15, decimals=0)),
        words=BEFORE,
        not_words=(GYRO, WHEEL),
        silent_is_right=True,
    ),
    Case(
        name="across_1970_four",
        group="before 1970",
        cause="An unset clock that crosses the time 0. The steps are right.",
        make=in_table(FOUR, POSE, faults.scaled_time(1.0, "s", first=-20.0, decimals=4)),
        words=BEFORE,
        not_words=(GYRO, WHEEL),
        silent_is_right=True,
    ),
    Case(
        name="can_before_1970",
        group="before 1970",
        cause="Times before 1970 in SavvyCAN's file. The steps are right.",
        make=in_can(SMALL, change=lambda log: _savvycan(log, -1_600_000_000_000_000, 63)),
        words=BEFORE,
        not_words=(GYRO, WHEEL),
        silent_is_right=True,
    ),
    Case(
        name="zero_rows_together_large",
        group="rows of time 0",
        cause="Twelve rows in the middle have time 0.",
        make=in_table(LARGE, Kit(), faults.zero_times(12, together=True, empty=False)),
        words=ZERO,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="zero_rows_scattered_omni",
        group="rows of time 0",
        cause="Eight rows here and there have time 0.",
        make=in_table(OMNI, POSE, faults.zero_times(8, together=False, empty=False)),
        words=ZERO,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="zero_rows_empty_four",
        group="rows of time 0",
        cause="Five rows in the middle have time 0, and all their values are 0.",
        make=in_table(FOUR, Kit(), faults.zero_times(5, together=True, empty=True)),
        words=ZERO,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="gyro_late_small",
        group="offset of a sensor",
        cause="The gyro is stamped 0.4 s late against the wheels.",
        make=in_table(SMALL, Kit(late_s={"gyro": 0.4})),
        words=LATE,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="gyro_early_four",
        group="offset of a sensor",
        cause="The gyro is stamped 0.3 s early against the wheels.",
        make=in_table(FOUR, Kit(truth="pose", late_s={"gyro": -0.3})),
        words=LATE,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="truth_late_small",
        group="offset of a sensor",
        cause="The ground truth is stamped 0.6 s late.",
        make=in_table(SMALL, Kit(truth="pose", late_s={"truth": 0.6})),
        words=LATE,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="truth_early_omni",
        group="offset of a sensor",
        cause="The ground truth is stamped 0.25 s early.",
        make=in_table(OMNI, Kit(gyro=False, truth="pose", truth_file=True, late_s={"truth": -0.25})),
        words=LATE,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="fixes_late_car",
        group="offset of a sensor",
        cause="The positions of the receiver are stamped 0.8 s late.",
        make=in_table(CAR, Kit(wheels="speed", fixes="geodetic", late_s={"fixes": 0.8})),
        words=LATE,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="fixes_late_large",
        group="offset of a sensor",
        cause="The positions of the receiver are stamped 0.5 s late.",
        make=in_table(LARGE, Kit(fixes="position", fix_hz=10.0, fix_sigma_m=0.01, late_s={"fixes": 0.5})),
        words=LATE,
        not_words=(GYRO, WHEEL),
    ),
    Case(
        name="steering_late_car",
        group="offset of a sensor",
        cause="The steering angle is stamped 0.7 s late against wheels and gyro.",
        make=in_table(CAR, Kit(wheels="speed", truth="pose", late_s={"steering": 0.7})),
        words=LATE,
        not_words=(GYRO, WHEEL),
    ),
]


def _shift_frames(log: CanLog, by_s: float) -> None:
    """Set the clock in the middle of a CAN log."""
    middle = log.frames[len(log.frames) // 2][0]
    log.frames = [(t + by_s if t > middle else t, name, data) for t, name, data in log.frames]


def _savvycan(log: CanLog, first_us: int, bits: int) -> None:
    """Write a CAN log as SavvyCAN does."""
    log.writer = savvycan(first_us, bits=bits)
    log.name = "drive.csv"


def _reversed_twist(bag: Bag) -> None:
    bag.twists = bag.twists * np.array([-1.0, 1.0, 1.0])


def _degrees_in_twist(bag: Bag) -> None:
    bag.twists = bag.twists * np.array([1.0, 1.0, 180.0 / np.pi])


def _world_twist(bag: Bag) -> None:
    """Give the twist in the axes of the map, as an old plug-in of a simulator does."""
    speed, yaw = bag.twists[:, 0], bag.poses[:, 2] + 1.2
    bag.twists = np.stack((speed * np.cos(yaw), speed * np.sin(yaw), bag.twists[:, 2]), axis=1)


TWIST = [
    Case(
        name="bag_twist_reversed",
        group="pose against twist",
        cause="The forward speed of the twist has the opposite sign of the motion of the pose.",
        make=in_bag(_reversed_twist),
        words=(r"twist",),
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="bag_twist_degrees",
        group="pose against twist",
        cause="The yaw rate of the twist is in deg/s.",
        make=in_bag(_degrees_in_twist),
        words=(r"twist",),
        not_words=(CLOCK,),
    ),
    Case(
        name="bag_twist_of_map",
        group="pose against twist",
        cause="The twist is in the axes of the map, not of the rover.",
        make=in_bag(_world_twist),
        words=(r"twist",),
        not_words=(GYRO, CLOCK),
    ),
]

SIGNS = [
    Case(
        name="unsigned_small_truth",
        group="unsigned speeds",
        cause="The speeds of the wheels have no sign; parts of the drive are backwards.",
        make=in_table(SMALL, Kit(wheels="speed", truth="pose"), faults.unsigned, back=True),
        words=UNSIGNED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="unsigned_four_positions",
        group="unsigned speeds",
        cause="The speeds of the wheels have no sign; parts of the drive are backwards.",
        make=in_table(FOUR, Kit(wheels="speed", fixes="geodetic"), faults.unsigned, back=True),
        words=UNSIGNED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="unsigned_car_truth",
        group="unsigned speeds",
        cause="The speeds of the wheels have no sign; parts of the drive are backwards.",
        make=in_table(
            CAR,
            Kit(wheels="speed", speed_unit="km/h", truth="position"),
            faults.unsigned,
            back=True,
            seconds=60.0,
        ),
        words=UNSIGNED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="unsigned_large_alone",
        group="unsigned speeds",
        cause="The wheel speeds have no sign; parts of the drive are backwards; there is only a gyro.",
        make=in_table(LARGE, SPEED, faults.unsigned, back=True),
        words=(*UNSIGNED, r"cannot be (seen|decided).*(sign|revers|backward)"),
        not_words=(CLOCK,),
        decidable=False,
    ),
    Case(
        name="left_reversed_small",
        group="wheel reversed",
        cause="The left wheel counts backwards.",
        make=in_table(SMALL, POSE, faults.reversed_wheels("left")),
        words=REVERSED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="right_reversed_later_large",
        group="wheel reversed",
        cause="The right wheel counts backwards from 55 % of the drive on.",
        make=in_table(LARGE, POSE, faults.reversed_wheels("right", share=0.55)),
        words=REVERSED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="one_of_four_reversed",
        group="wheel reversed",
        cause="The rear left wheel of four counts backwards; the other three and the gyro agree.",
        make=in_table(FOUR, Kit(), faults.reversed_wheels("rl")),
        words=REVERSED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="one_of_three_reversed_omni",
        group="wheel reversed",
        cause="One of three wheels counts backwards.",
        make=in_table(OMNI, POSE, faults.reversed_wheels("w1")),
        words=REVERSED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="all_reversed_four_positions",
        group="wheel reversed",
        cause="All wheels count backwards.",
        make=in_table(FOUR, RTK, faults.reversed_wheels("fl", "fr", "rl", "rr")),
        words=REVERSED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="all_reversed_small_alone",
        group="wheel reversed",
        cause="Both wheels count backwards, or the gyro has the wrong sign: nothing decides.",
        make=in_table(SMALL, Kit(), faults.reversed_wheels("left", "right")),
        words=(r"wheel.*(gyro|yaw rate|imu)", r"(gyro|yaw rate|imu).*wheel"),
        not_words=(CLOCK,),
        decidable=False,
    ),
    Case(
        name="exchanged_small_truth",
        group="wheels exchanged",
        cause="Left and right wheel are exchanged.",
        make=in_table(SMALL, POSE, faults.exchanged_wheels("left", "right")),
        words=EXCHANGED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="exchanged_large_no_gyro",
        group="wheels exchanged",
        cause="Left and right wheel are exchanged.",
        make=in_table(LARGE, Kit(gyro=False, truth="position"), faults.exchanged_wheels("left", "right")),
        words=EXCHANGED,
        not_words=(CLOCK,),
    ),
    Case(
        name="exchanged_later_small",
        group="wheels exchanged",
        cause="Left and right wheel are exchanged from 45 % of the drive on.",
        make=in_table(SMALL, POSE, faults.exchanged_wheels("left", "right", 0.45)),
        words=EXCHANGED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="exchanged_omni_truth",
        group="wheels exchanged",
        cause="Two of three wheels are exchanged.",
        make=in_table(OMNI, POSE, faults.exchanged_wheels("w0", "w2")),
        words=EXCHANGED,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="exchanged_large_gyro_only",
        group="wheels exchanged",
        cause="Left and right wheel are exchanged, or the gyro has the wrong sign: nothing decides.",
        make=in_table(LARGE, Kit(), faults.exchanged_wheels("left", "right")),
        words=(r"wheel.*(gyro|yaw rate|imu)", r"(gyro|yaw rate|imu).*wheel"),
        not_words=(CLOCK,),
        decidable=False,
    ),
    Case(
        name="gyro_reversed_small_truth",
        group="gyro sign",
        cause="The gyro has the wrong sign.",
        make=in_table(SMALL, POSE, faults.scaled_columns(-1.0, "gyro")),
        words=GYRO_SIGN,
        not_words=(WHEEL, CLOCK),
    ),
    Case(
        name="gyro_reversed_four_positions",
        group="gyro sign",
        cause="The gyro has the wrong sign.",
        make=in_table(FOUR, RTK, faults.scaled_columns(-1.0, "gyro")),
        words=GYRO_SIGN,
        not_words=(WHEEL, CLOCK),
    ),
    Case(
        name="gyro_reversed_omni_truth",
        group="gyro sign",
        cause="The gyro has the wrong sign.",
        make=in_table(OMNI, POSE, faults.scaled_columns(-1.0, "gyro")),
        words=GYRO_SIGN,
        not_words=(WHEEL, CLOCK),
    ),
    Case(
        name="gyro_reversed_car_positions",
        group="gyro sign",
        cause="The gyro has the wrong sign; wheels, steering and positions agree.",
        make=in_table(CAR, ROAD, faults.scaled_columns(-1.0, "gyro")),
        words=GYRO_SIGN,
        not_words=(WHEEL, CLOCK),
    ),
    Case(
        name="gyro_reversed_large_alone",
        group="gyro sign",
        cause="The gyro has the wrong sign, or the wheels are exchanged: nothing decides.",
        make=in_table(LARGE, Kit(), faults.scaled_columns(-1.0, "gyro")),
        words=(r"wheel.*(gyro|yaw rate|imu)", r"(gyro|yaw rate|imu).*wheel"),
        not_words=(CLOCK,),
        decidable=False,
    ),
]

FACTORS = [
    Case(
        name="gyro_degrees_small_truth",
        group="gyro scale",
        cause="The yaw rate is in deg/s, described as rad/s.",
        make=in_table(SMALL, POSE, faults.scaled_columns(180 / np.pi, "gyro")),
        words=GYRO_FACTOR,
        not_words=(WHEEL, CLOCK),
    ),
    Case(
        name="gyro_degrees_car",
        group="gyro scale",
        cause="The yaw rate is in deg/s, described as rad/s.",
        make=in_table(CAR, SPEED, faults.scaled_columns(180 / np.pi, "gyro")),
        words=GYRO_FACTOR,
        not_words=(WHEEL, CLOCK),
    ),
    Case(
        name="gyro_radians_four",
        group="gyro scale",
        cause="The yaw rate is in rad/s, described as deg/s.",
        make=in_table(FOUR, POSE, faults.gyro_unit("deg/s")),
        words=GYRO_FACTOR,
        not_words=(WHEEL, CLOCK),
    ),
    Case(
        name="gyro_scale_small_truth",
        group="gyro scale",
        cause="The gyro measures 1.25 times the yaw rate.",
        make=in_table(SMALL, POSE, faults.scaled_columns(1.25, "gyro")),
        words=GYRO_FACTOR,
        not_words=(WHEEL, CLOCK),
    ),
    Case(
        name="gyro_scale_large_positions",
        group="gyro scale",
        cause="The gyro measures 0.8 times the yaw rate.",
        make=in_table(LARGE, RTK, faults.scaled_columns(0.8, "gyro"), seconds=60.0),
        words=GYRO_FACTOR,
        not_words=(WHEEL, CLOCK),
    ),
    Case(
        name="rpm_as_rad_s_small",
        group="wheel unit",
        cause="The wheel speeds are in rpm, described as rad/s.",
        make=in_table(
            SMALL, Kit(wheels="speed", speed_unit="rpm", truth="pose"), faults.wheel_entry(unit="rad/s")
        ),
        words=WHEEL_FACTOR,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="rad_s_as_rpm_large",
        group="wheel unit",
        cause="The wheel speeds are in rad/s, described as rpm.",
        make=in_table(LARGE, Kit(wheels="speed", fixes="geodetic"), faults.wheel_entry(unit="rpm")),
        words=WHEEL_FACTOR,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="degrees_as_rad_omni",
        group="wheel unit",
        cause="The wheel speeds are in deg/s, described as rad/s.",
        make=in_table(OMNI, Kit(wheels="speed", speed_unit="deg/s"), faults.wheel_entry(unit="rad/s")),
        words=WHEEL_FACTOR,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="ticks_as_rad_small",
        group="wheel unit",
        cause="The wheel positions are ticks, described as rad.",
        make=in_table(SMALL, Kit(ticks=4096, truth="pose"), faults.ticks_as_rad),
        words=WHEEL_FACTOR,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="quadrature_four",
        group="wheel unit",
        cause="A turn has 4096 ticks, described as 1024: four times too many turns.",
        make=in_table(FOUR, Kit(ticks=4096, truth="pose"), faults.wheel_entry(ticks_per_turn=1024)),
        words=WHEEL_FACTOR,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="few_ticks_omni",
        group="wheel unit",
        cause="A turn has 512 ticks, described as 2048: a quarter of the turns.",
        make=in_table(OMNI, Kit(ticks=512, truth="pose"), faults.wheel_entry(ticks_per_turn=2048)),
        words=WHEEL_FACTOR,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="km_h_as_m_s_car",
        group="wheel unit",
        cause="The wheel speeds are in km/h, described as m/s.",
        make=in_table(
            CAR,
            Kit(wheels="speed", speed_unit="km/h", fixes="geodetic", fix_sigma_m=0.3, fix_correlation_s=2.0),
            faults.wheel_entry(unit="m/s"),
        ),
        words=WHEEL_FACTOR,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="can_rpm_as_rad_s",
        group="wheel unit",
        cause="The wheel speeds are in rpm, described as rad/s.",
        make=in_can(SMALL, CanKit(speeds=True, speed_factor=30 / np.pi)),
        words=WHEEL_FACTOR,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="radius_small_truth",
        group="radius or track",
        cause="The radius in the description is 20 % too large.",
        make=in_table(SMALL, POSE, faults.wrong_radius(1.2)),
        words=RADIUS,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="radius_four_positions",
        group="radius or track",
        cause="The radius in the description is 25 % too small.",
        make=in_table(FOUR, RTK, faults.wrong_radius(0.75), seconds=60.0),
        words=RADIUS,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="radius_omni_truth",
        group="radius or track",
        cause="The radius in the description is 30 % too large.",
        make=in_table(OMNI, POSE, faults.wrong_radius(1.3)),
        words=RADIUS,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="radius_of_left_large",
        group="radius or track",
        cause="The radius of the left wheel in the description is 12 % too large.",
        make=in_table(LARGE, POSE, faults.wrong_radius(1.12, only=0)),
        words=RADIUS,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="track_small_truth",
        group="radius or track",
        cause="The track in the description is 25 % too wide.",
        make=in_table(SMALL, POSE, faults.wrong_track(1.25)),
        words=TRACK,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="track_four_truth",
        group="radius or track",
        cause="The track in the description is 20 % too narrow.",
        make=in_table(FOUR, POSE, faults.wrong_track(0.8)),
        words=TRACK,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="radius_small_alone",
        group="radius or track",
        cause="The radius in the description is 25 % too large, and nothing but the wheels was recorded.",
        make=in_table(SMALL, GYROLESS, faults.wrong_radius(1.25)),
        words=(r"radius", r"factor", r"cannot be seen"),
        not_words=(CLOCK,),
        decidable=False,
    ),
    Case(
        name="radius_or_track_large_gyro",
        group="radius or track",
        cause="The radius is 30 % too large or the track as much too narrow: a gyro does not decide.",
        make=in_table(LARGE, Kit(), faults.wrong_radius(1.3)),
        words=(r"radius", r"\btrack\b", r"factor", r"cannot be seen"),
        not_words=(CLOCK,),
        decidable=False,
    ),
    Case(
        name="steering_wheel_car_gyro",
        group="steering ratio",
        cause="The column holds the angle of the steering wheel (ratio 15), described as the front wheel's.",
        make=in_table(CAR, SPEED, faults.steering_wheel(15.0)),
        words=RATIO,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="steering_wheel_car_positions",
        group="steering ratio",
        cause="The column holds the angle of the steering wheel (ratio 15), described as the front wheel's.",
        make=in_table(CAR, ROAD, faults.steering_wheel(15.0), seconds=60.0),
        words=RATIO,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="steering_wheel_car_truth_no_gyro",
        group="steering ratio",
        cause="The column holds the angle of the steering wheel (ratio 16), described as the front wheel's.",
        make=in_table(CAR, Kit(gyro=False, truth="pose"), faults.steering_wheel(16.0)),
        words=RATIO,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="can_steering_wheel_car",
        group="steering ratio",
        cause="The signal is the angle of the steering wheel (ratio 15); the mapping gives no ratio.",
        make=in_can(CAR, CanKit(speeds=True, steering_ratio=15.0, has_ratio=False)),
        words=RATIO,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="coordinates_car_fixes",
        group="coordinates",
        cause="Latitude and longitude are exchanged.",
        make=in_table(CAR, ROAD, faults.exchanged_coordinates("fixes")),
        words=COORDINATES,
        not_words=(GYRO, WHEEL, CLOCK),
    ),
    Case(
        name="coordinates_large_fixes",
        group="coordinates",
        cause="Latitude and longitude are exchanged.",
        make=in_table(LARGE, RTK, faults.exchanged_coordinates("fixes")),
        words=COORDINATES,
        not_words=(GYRO, WHEEL, CLOCK),
    ),
    Case(
        name="coordinates_four_truth",
        group="coordinates",
        cause="Latitude and longitude are exchanged.",
        make=in_table(FOUR, Kit(truth="geodetic", truth_sigma_m=0.01), faults.exchanged_coordinates("truth")),
        words=COORDINATES,
        not_words=(GYRO, WHEEL, CLOCK),
    ),
    Case(
        name="zero_island_car",
        group="first position 0, 0",
        cause="The first position of the receiver is latitude 0, longitude 0.",
        make=in_table(CAR, ROAD, faults.first_positions_zero("fixes", 1)),
        words=NULL_ISLAND,
        not_words=(GYRO, WHEEL, CLOCK),
    ),
    Case(
        name="zero_island_four",
        group="first position 0, 0",
        cause="The first seven positions of the receiver are latitude 0, longitude 0.",
        make=in_table(FOUR, RTK, faults.first_positions_zero("fixes", 7)),
        words=NULL_ISLAND,
        not_words=(GYRO, WHEEL, CLOCK),
    ),
    Case(
        name="zero_island_truth_large",
        group="first position 0, 0",
        cause="The first three positions of the ground truth are latitude 0, longitude 0.",
        make=in_table(
            LARGE, Kit(truth="geodetic", truth_sigma_m=0.01), faults.first_positions_zero("truth", 3)
        ),
        words=NULL_ISLAND,
        not_words=(GYRO, WHEEL, CLOCK),
    ),
    Case(
        name="held_wheels_small",
        group="held or coarse",
        cause="The wheels are sampled at 10 Hz and held in rows of 50 Hz.",
        make=in_table(SMALL, Kit(ticks=4096), faults.held(5, "left", "right")),
        words=HELD,
        not_words=(GYRO, CLOCK),
        silent_is_right=True,
    ),
    Case(
        name="held_wheels_car",
        group="held or coarse",
        cause="The wheel speeds are sampled at 10 Hz and held in rows of 50 Hz.",
        make=in_table(CAR, SPEED, faults.held(5, "v_rl", "v_rr")),
        words=HELD,
        not_words=(GYRO, CLOCK),
        silent_is_right=True,
    ),
    Case(
        name="held_gyro_large",
        group="held or coarse",
        cause="The gyro is sampled at 10 Hz and held in rows of 50 Hz.",
        make=in_table(LARGE, POSE, faults.held(5, "gyro")),
        words=HELD,
        not_words=(r"(gyro|imu|yaw rate).*(stuck|sign|scale|wrong axis|jumped)", WHEEL, CLOCK),
        silent_is_right=True,
    ),
    Case(
        name="steps_of_8_mm_small",
        group="held or coarse",
        cause="The encoders have steps of 8 mm (47 a turn).",
        make=in_table(SMALL, Kit(ticks=47)),
        words=COARSE,
        not_words=(GYRO, CLOCK),
        silent_is_right=True,
    ),
    Case(
        name="steps_of_8_mm_four_truth",
        group="held or coarse",
        cause="The encoders have steps of 8 mm (94 a turn).",
        make=in_table(FOUR, Kit(ticks=94, truth="pose")),
        words=COARSE,
        not_words=(GYRO, CLOCK),
        silent_is_right=True,
    ),
    Case(
        name="dead_encoder_small",
        group="dead encoder",
        cause="The encoder of the left wheel repeats its count for 4 s, then recovers.",
        make=in_table(SMALL, Kit(), faults.dead_encoder("left", 0.5, 4.0)),
        words=ENCODER,
        not_words=(GYRO, CLOCK),
    ),
    Case(
        name="dead_encoder_large_truth",
        group="dead encoder",
        cause="The encoder of the right wheel repeats its count for 5 s, then recovers.",
        make=in_table(LARGE, POSE, faults.dead_encoder("right", 0.4, 5.0)),
        words=ENCODER,
        not_words=(GYRO, CLOCK),
    ),
]

FAULTY = [*UNITS_OF_TIME, *CLOCKS, *TWIST, *SIGNS, *FACTORS]
