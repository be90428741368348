"""The cases of the fault matrix: rover, device, fault, and what must come of it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from benchmarks.safety.faults.injection import (
    Biased,
    Chance,
    Changed,
    Disturb,
    Drifting,
    Garbage,
    Held,
    Looped,
    LowPassed,
    Multiplied,
    Noise,
    OneIn,
    Painted,
    RandomValues,
    Reorder,
    Repeated,
    Rotated,
    Scaled,
    White,
    black,
    duplicate,
    flood,
    frozen,
    frozen_with_new_stamps,
    hunting,
    late,
    mirrored,
    old_stamps,
    silence,
    stall,
    turned,
    with_old_stamp,
)
from benchmarks.safety.faults.wires import (
    Change,
    CompassSentences,
    DriveSupply,
    GyroFrames,
    PositionSentences,
    RobotinoReplies,
    RobotinoRequests,
    RobotinoSupply,
    WheelSetPoints,
    WheelStates,
    Wire,
)
from drivers.link import CameraImage
from drivers.nmea import encode_sentence

FOR_EVER_S = 1e6
NO_FIX = encode_sentence("GNGGA,120000.00,,,,,0,00,99.9,,M,,M,,")
GYRO_PER_RAD_S = 32768 / (2000 * np.pi / 180)


class Duty(StrEnum):
    """What must come of a fault.

    STOP: where the device has no fresh value for longer than its age limit, or its link breaks, zero
        setpoints within 150 ms of that; honest in any case.
    NOTICE: the rover stops with a reason that names the device, or shows it as a suspicion, within 1.5 s or
        0.15 m.
    HONEST: the estimate stays within the 99.9 % bound; no stop is needed.
    PHYSICS: no measurement of the rover shows it; `Case.why` is the argument.
    """

    STOP = "stop"
    NOTICE = "notice"
    HONEST = "honest"
    PHYSICS = "by physics"


@dataclass(frozen=True, kw_only=True)
class Case:
    """One row of the table.

    Attributes:
        device: Its name in the configuration; "process" for the program itself.
        names: The reason must contain one of these words for the fault to count as named.
        duration_s: Of the fault; `FOR_EVER_S` where it stays.
        to_host: Makes what it does to what the device sends.
        to_device: Makes what it does to what the device receives.
        frames: Makes what it does to the frames of a camera.
        is_unplug: The plug is pulled.
        pause_s: How long the process does not run.
        after_s: From the first motion to the fault.
        by_heading: Only a heading can show it, once the gyro has turned wrongly by `HEADING_SHOWS_RAD`.
        is_excited: Whether a Robotino excites its yaw to read its slip.
        why: Of a fault that cannot be noticed: why not.
        safety: Keys of [safety] that the rover has for this case.
        zero_bar_s: Zero setpoints must come this long after the fault, and a warning before; None for no bar.
        also: A fault of another device at the same time; of it only what it does counts.
    """

    rover: str
    device: str
    fault: str
    duty: Duty
    names: tuple[str, ...] = ()
    duration_s: float = 1.0
    to_host: Callable[[np.random.Generator], Disturb[bytes]] | None = None
    to_device: Callable[[np.random.Generator], Disturb[bytes]] | None = None
    frames: Callable[[np.random.Generator], Disturb[CameraImage]] | None = None
    is_unplug: bool = False
    pause_s: float = 0.0
    after_s: float = 3.0
    by_heading: bool = False
    is_excited: bool = True
    why: str = ""
    safety: Mapping[str, float] = field(default_factory=dict)
    zero_bar_s: float | None = None
    also: "Case | None" = None

    @property
    def is_of_device(self) -> bool:
        """Whether a device fails, and not the program."""
        return self.device not in ("process", "program")

    @property
    def title(self) -> str:
        """Its name on the command line."""
        return f"{self.rover}/{self.device}/{self.fault}"


@dataclass(frozen=True)
class _Device:
    """How a device talks, and what its faults are called."""

    rover: str
    name: str
    wire: Wire
    names: tuple[str, ...]
    kept: int = 0

    def case(self, fault: str, duty: Duty, **settings: object) -> Case:
        return Case(
            **{"rover": self.rover, "device": self.name, "fault": fault, "duty": duty, "names": self.names}
            | settings  # type: ignore[arg-type]
        )

    def lasting(
        self, fault: str, change: Callable[[], Change], why: str = "", *, by_heading: bool = False
    ) -> Case:
        """Return a case whose numbers are wrong until the end of the run."""
        return self.case(
            fault,
            Duty.PHYSICS if why else Duty.NOTICE,
            duration_s=FOR_EVER_S,
            to_host=lambda _: Changed(self.wire, change()),
            by_heading=by_heading,
            why=why,
        )


WHEELS = {
    "robotino": _Device("robotino", "board", RobotinoReplies(), ("board", "wheel")),
    "el-dorado": _Device("el-dorado", "wheels", WheelStates(), ("wheel",), kept=8),
}
SET_POINTS: dict[str, Wire] = {"robotino": RobotinoRequests(), "el-dorado": WheelSetPoints()}
SUPPLIES: dict[str, Wire] = {"robotino": RobotinoSupply(), "el-dorado": DriveSupply()}
RULE_BAR_S = 0.3
"""After the time that a rule states."""
FULL_SCALE = {"robotino": 2**31 - 1, "el-dorado": 2**19 - 1}
GYROS = {rover: _Device(rover, "imu", GyroFrames(), ("imu", "gyro")) for rover in ("robotino", "el-dorado")}
GNSS = _Device("differential", "gnss", PositionSentences(), ("gnss",))
COMPASS = _Device("el-dorado", "compass", CompassSentences(), ("compass", "heading"))

NO_EXCITATION = (
    "the rover drives straight on: a heading that does not change has no size, sign or lag to be wrong"
)


def all_cases() -> list[Case]:
    """Return every case that runs in simulated time."""
    cases: list[Case] = []
    for rover in ("robotino", "el-dorado"):
        cases += [*_stream(WHEELS[rover]), *_wrong_wheels(rover)]
        cases += [*_stream(GYROS[rover]), *_wrong_gyros(rover), *_pauses(rover), *rule_cases(rover)]
    return [*cases, *_stream(COMPASS), *_wrong_compasses(), *_cameras(), *_receivers()]


def _stream(device: _Device) -> Iterator[Case]:
    """Yield the faults of a plug and a bus, for a second."""
    yield device.case("unplug", Duty.STOP, is_unplug=True)
    yield device.case("freeze", Duty.STOP, to_host=lambda _: silence)
    yield device.case("stall", Duty.STOP, to_host=lambda _: stall)
    yield device.case("slow (1 in 10)", Duty.STOP, to_host=lambda _: OneIn(10))
    yield device.case("half lost", Duty.STOP, to_host=Chance)
    yield device.case("late by 0.3 s", Duty.STOP, to_host=lambda _: late)
    yield device.case("garbage", Duty.STOP, to_host=lambda rng: Garbage(rng, device.kept))
    yield device.case("valid flood", Duty.STOP, to_host=lambda _: flood)
    yield device.case("duplicated", Duty.STOP, to_host=lambda _: duplicate)
    yield device.case("reordered", Duty.STOP, to_host=lambda _: Reorder())
    yield device.case("old stamps", Duty.STOP, to_host=lambda _: old_stamps)


def _wrong_wheels(rover: str) -> Iterator[Case]:
    device, high = WHEELS[rover], FULL_SCALE[rover]
    yield device.case(
        "wrong values",
        Duty.NOTICE,
        duration_s=FOR_EVER_S,
        to_host=lambda rng: Changed(device.wire, RandomValues(rng, -high, high)),
    )
    yield device.lasting("all reversed", lambda: Scaled(-1.0))
    yield device.lasting("one reversed", lambda: Scaled(-1.0, (0,)))
    yield device.lasting("all stuck", Held)
    yield device.lasting("one stuck", lambda: Scaled(0.0, (0,)))
    yield device.case("loop of 0.25 s", Duty.NOTICE, duration_s=4.0, to_host=lambda _: Looped(0.25))
    yield device.lasting(
        "all scaled by 2",
        lambda: Scaled(2.0),
        "a drive follows its own encoder, so setpoint and reading agree; half the way is a slip of 50 %",
    )
    yield device.lasting(
        "all scaled by 1.1",
        lambda: Scaled(1.1),
        "encoders that count 10 % too much are wheels that slip 10 %",
    )
    yield device.lasting(
        "low-pass 0.5 s",
        lambda: LowPassed(0.5),
        "at constant speed a low-pass of an angle is a constant lag: 0.5 s of travel once, within the slip",
    )
    if rover == "robotino":
        yield device.lasting("wheels swapped", lambda: Rotated((1, 0, 2, 4, 3, 5)))
    for name, change in (
        ("one wheel jammed", lambda: Scaled(0.0, (0,))),
        ("one motor reversed", lambda: Scaled(-1.0, (0,))),
        ("motors dead", lambda: Scaled(0.0)),
    ):
        yield device.case(
            name,
            Duty.NOTICE,
            duration_s=FOR_EVER_S,
            to_device=lambda _, change=change: Changed(SET_POINTS[rover], change()),
        )


LOST_UNDER_LOAD_RAD_S = {"robotino": 0.5, "el-dorado": 0.3}
"""What the simulated drives may lose under load; the shipped 0.5 would hide most of the El-Dorado's lack."""


def rule_cases(rover: str) -> Iterator[Case]:
    """Yield the faults that a rule stops which is off as shipped."""
    device = WHEELS[rover]
    yield device.case(
        "supply at 70 %",
        Duty.HONEST,
        duration_s=FOR_EVER_S,
        to_host=lambda _: Changed(SUPPLIES[rover], Scaled(0.7)),
        safety={"least_supply_v": 20.0},
        zero_bar_s=1.0 + RULE_BAR_S,
    )
    yield device.case(
        "motors obey 40 %",
        Duty.HONEST,
        duration_s=FOR_EVER_S,
        to_device=lambda _: Changed(SET_POINTS[rover], Scaled(0.4)),
        safety={"response_ratio": 0.5, "stall_set_point_rad_s": LOST_UNDER_LOAD_RAD_S[rover]},
        zero_bar_s=5.0 + RULE_BAR_S,
    )


def _wrong_gyros(rover: str) -> Iterator[Case]:
    device, has_heading = GYROS[rover], rover == COMPASS.rover
    yield device.case(
        "wrong values",
        Duty.NOTICE,
        duration_s=FOR_EVER_S,
        to_host=lambda rng: Changed(device.wire, RandomValues(rng, -32768, 32767)),
    )
    yield device.lasting("reversed", lambda: Scaled(-1.0), by_heading=has_heading)
    yield device.lasting("stuck", Held)
    yield device.lasting("dead (0)", lambda: Scaled(0.0))
    yield device.lasting("biased +0.5 rad/s", lambda: Biased(0.5 * GYRO_PER_RAD_S, (2,)))
    yield device.lasting("biased +30 rad/s", lambda: Biased(30.0 * GYRO_PER_RAD_S, (2,)))
    yield device.lasting("rotated axis", lambda: Rotated((1, 2, 0)), by_heading=has_heading)
    yield device.lasting(
        "biased +0.5 deg/s",
        lambda: Biased(np.radians(0.5) * GYRO_PER_RAD_S, (2,)),
        ""
        if has_heading
        else "wheels that slip unevenly by a few percent turn the rover as slowly; only a heading shows it",
        by_heading=has_heading,
    )
    yield device.lasting("scaled by 1.1", lambda: Scaled(1.1), NO_EXCITATION)
    yield device.lasting("low-pass 0.5 s", lambda: LowPassed(0.5), NO_EXCITATION)
    yield device.case("last 2 s again", Duty.NOTICE, duration_s=FOR_EVER_S, to_host=lambda _: Looped(2.0))
    yield device.case(
        "noise without a signal",
        Duty.HONEST if has_heading else Duty.NOTICE,
        duration_s=FOR_EVER_S,
        to_host=lambda rng: Changed(device.wire, White(rng, 0.002 * GYRO_PER_RAD_S)),
    )
    yield device.case(
        "noise of 0.3 rad/s",
        Duty.NOTICE,
        duration_s=FOR_EVER_S,
        to_host=lambda rng: Changed(device.wire, White(rng, 0.3 * GYRO_PER_RAD_S)),
    )


def _wrong_compasses() -> Iterator[Case]:
    yield COMPASS.case(
        "wrong values",
        Duty.HONEST,
        duration_s=FOR_EVER_S,
        to_host=lambda rng: Changed(COMPASS.wire, RandomValues(rng, 0.0, 360.0)),
    )
    yield COMPASS.case(
        "biased 30 deg",
        Duty.HONEST,
        duration_s=FOR_EVER_S,
        to_host=lambda _: Changed(COMPASS.wire, Biased(30.0, (0,))),
    )
    yield COMPASS.case(
        "mounted 90 deg off",
        Duty.HONEST,
        duration_s=FOR_EVER_S,
        to_host=lambda _: Changed(COMPASS.wire, Biased(90.0, (0,))),
    )
    yield COMPASS.lasting(
        "biased 2 deg",
        lambda: Biased(2.0, (0,)),
        "the deviation of a fluxgate compass is as large, and it turns with the heading",
    )
    yield COMPASS.case(
        "100 times as often", Duty.NOTICE, duration_s=FOR_EVER_S, to_host=lambda _: Multiplied(100)
    )
    yield COMPASS.case("last 2 s again", Duty.NOTICE, duration_s=FOR_EVER_S, to_host=lambda _: Looped(2.0))
    yield COMPASS.lasting("reversed", lambda: Scaled(-1.0), NO_EXCITATION)
    yield COMPASS.lasting("stuck", Held, NO_EXCITATION)
    yield COMPASS.lasting("low-pass 5 s", lambda: LowPassed(5.0), NO_EXCITATION)


def _pauses(rover: str) -> Iterator[Case]:
    yield Case(rover=rover, device="process", fault="none", duty=Duty.HONEST)
    for pause_s in (0.3, 1.0, 3.0):
        yield Case(
            rover=rover,
            device="process",
            fault=f"paused {pause_s:g} s",
            duty=Duty.HONEST,
            duration_s=pause_s,
            pause_s=pause_s,
        )


def _receivers() -> Iterator[Case]:
    """Yield the faults of a GNSS receiver, after the axes of its frame have been found."""

    def case(fault: str, duty: Duty, **settings: object) -> Case:
        return GNSS.case(fault, duty, after_s=15.0, **settings)

    def step(size_m: float) -> Callable[[np.random.Generator], Disturb[bytes]]:
        return lambda _: Changed(GNSS.wire, Biased(size_m, (1,)))

    yield case("unplug", Duty.HONEST, is_unplug=True)
    yield case("freeze", Duty.HONEST, to_host=lambda _: silence)
    yield case("stall", Duty.HONEST, to_host=lambda _: stall)
    yield case("half lost", Duty.HONEST, to_host=Chance)
    yield case("late by 0.3 s", Duty.HONEST, to_host=lambda _: late)
    yield case("garbage", Duty.HONEST, to_host=Garbage)
    yield case("duplicated", Duty.HONEST, to_host=lambda _: duplicate)
    yield case("reordered", Duty.HONEST, to_host=lambda _: Reorder())
    yield case(
        "stale (same place and time)", Duty.HONEST, duration_s=FOR_EVER_S, to_host=lambda _: Repeated()
    )
    yield case("no fix", Duty.HONEST, duration_s=FOR_EVER_S, to_host=lambda _: Repeated(NO_FIX))
    yield case(
        "position stays, time goes on",
        Duty.NOTICE,
        duration_s=FOR_EVER_S,
        to_host=lambda _: Changed(GNSS.wire, Held()),
    )
    yield case(
        "drift of 0.3 m/s",
        Duty.NOTICE,
        duration_s=FOR_EVER_S,
        to_host=lambda _: Changed(GNSS.wire, Drifting(0.3, (1,))),
    )
    for fault, factor in (("north mirrored", -1.0), ("north half", 0.5)):
        yield case(
            fault,
            Duty.HONEST,
            duration_s=FOR_EVER_S,
            to_host=lambda _, factor=factor: Changed(GNSS.wire, Scaled(factor, (0,))),
        )
    yield case("jump of 1 m for 0.5 s", Duty.HONEST, duration_s=0.5, to_host=step(1.0))
    yield case("jump of 20 m for 0.5 s", Duty.HONEST, duration_s=0.5, to_host=step(20.0))
    yield case("multipath step of 1 m", Duty.NOTICE, duration_s=FOR_EVER_S, to_host=step(1.0))
    yield case("multipath step of 0.2 m", Duty.NOTICE, duration_s=FOR_EVER_S, to_host=step(0.2))
    yield case(
        "multipath step of 0.05 m",
        Duty.PHYSICS,
        duration_s=FOR_EVER_S,
        to_host=step(0.05),
        why="wheels that slip between two fixes, and the noise of the receiver, look the same",
    )


def _cameras() -> Iterator[Case]:
    painted: dict[str, Callable[[np.random.Generator], Disturb[CameraImage]]] = {
        "freeze": lambda _: silence,
        "stall": lambda _: stall,
        "late by 0.3 s": lambda _: late,
        "duplicated": lambda _: duplicate,
        "black": lambda _: Painted(black),
        "stuck": lambda _: Painted(frozen),
        "stuck, new stamps": lambda _: Painted(frozen_with_new_stamps),
        "old stamps": lambda _: Painted(with_old_stamp),
        "garbage": lambda rng: Painted(Noise(rng)),
        "mirrored": lambda _: Painted(mirrored),
        "turned 10 deg": lambda _: Painted(turned),
        "exposure hunts": lambda _: Painted(hunting),
    }
    common = {"rover": "el-dorado", "device": "camera", "duty": Duty.HONEST, "duration_s": 2.0}
    yield Case(fault="unplug", is_unplug=True, **common)  # type: ignore[arg-type]
    for fault, frames in painted.items():
        yield Case(fault=fault, frames=frames, **common)  # type: ignore[arg-type]
