"""What a page shows of a running loop, and what a page orders: plain data between two processes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from typing_extensions import TypedDict

from controllers.operator import OperatorInput
from rover_hil.config import Config
from rover_hil.run.executive import End


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOrder:
    """Run a rover.

    Attributes:
        source: Name of the configuration.
        config: As to be run, its mission included.
        log_path: Log to write; the report goes beside it.
        limit_s: End after this time.
        is_virtual: Run the simulated rover.
    """

    source: str
    config: Config
    log_path: Path
    limit_s: float
    is_virtual: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class EndOrder:
    """End the run."""

    end: End
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Confirmation:
    """The operator has clicked that the stopped rover may move again.

    Attributes:
        stops: Number of such stops in the view that the page showed then.
    """

    stops: int


Order: TypeAlias = OperatorInput | EndOrder | Confirmation


class DeviceView(TypedDict):
    """Health of one device; `age_s` is None before its first sample."""

    name: str
    state: str
    rate_hz: float
    age_s: float | None
    reason: str


class View(TypedDict):
    """What a page shows of a cycle.

    Attributes:
        t_s: Time since the first cycle.
        pose: x and y in m, yaw in rad, by the filter; `odometry` by the wheels alone.
        truth: The same of a simulated rover, from where it was at first; None of a real one.
        covariance: xx, xy, yy in m2 and yaw in rad2.
        headings: Yaw of each heading device in rad, from an arbitrary zero.
        slip: Slip ratio of each wheel, or of the rover where only that is estimated; None where not valid.
        slip_names: What each entry of `slip` is.
        slip_reason: Why the first entry that is not valid is not, or why all are unsure.
        assumed: What is assumed about slip that nothing measures.
        suspicion: What may be wrong although it stops nothing; empty for nothing.
        current_a: Newest current of each wheel; None before the first.
        set_rad_s: Setpoints as sent.
        work_us: Longest time of a cycle since the view before; `late_us` likewise.
        gains: Gains that the operator has changed.
        lost_s: Real time by which a simulated run has fallen behind.
        dropped: Views that the page was too slow to take.
        waits_for_operator: Whether the rover stays stopped, for `reason`, until the operator confirms.
        stops: Number of stops of this run that waited for the operator, and of confirmations; part of a
            confirmation.
    """

    kind: Literal["view"]
    t_s: float
    mode: str
    reason: str
    pose: tuple[float, float, float]
    odometry: tuple[float, float, float]
    truth: tuple[float, float, float] | None
    covariance: tuple[float, float, float, float]
    headings: dict[str, float]
    slip: list[float | None]
    slip_names: list[str]
    slip_reason: str
    assumed: str
    suspicion: str
    current_a: list[float | None]
    set_rad_s: Sequence[float]
    limit: str
    cross_track_m: float | None
    devices: list[DeviceView]
    work_us: float
    late_us: float
    cycles: int
    gains: Mapping[str, float]
    lost_s: float
    dropped: int
    waits_for_operator: bool
    stops: int


class Picture(TypedDict):
    """A frame of a camera; `words` describe the trace in it."""

    kind: Literal["picture"]
    camera: str
    words: str
    jpeg: bytes


class Ended(TypedDict):
    """The run has ended; the report is being written."""

    kind: Literal["ended"]
    reason: str


class Reported(TypedDict):
    """The report has been written."""

    kind: Literal["reported"]


class Failed(TypedDict):
    """The run could not begin or go on, or its report could not be written."""

    kind: Literal["failed"]
    error: str


Notice: TypeAlias = View | Picture | Ended | Reported | Failed
