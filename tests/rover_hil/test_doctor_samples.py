"""The doctor's checks of what the devices said, on made-up samples."""

import datetime as dt
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from drivers.camera.settings import CameraSettings
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.canopen_wheels.settings import CanopenWheelsSettings
from drivers.clock import nanoseconds
from drivers.driver import DeviceState, Health
from drivers.link import Received
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.registry import AnyDeviceSettings
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import (
    BumperSample,
    FaultSample,
    FrameSample,
    HeadingReference,
    HeadingSample,
    PowerSample,
    RateSample,
    Sample,
)
from rover_hil.doctor.devices.clocks import check_device_clock
from rover_hil.doctor.devices.faults import check_faults
from rover_hil.doctor.devices.frames import check_frames
from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.devices.no_data import check_no_data
from rover_hil.doctor.devices.rejections import advice_for, check_rejections
from rover_hil.doctor.devices.streams import Part, check_breaks, check_streams, stream_of
from rover_hil.doctor.finding import Finding, Level

COMPASS = NmeaCompassSettings(port="/dev/null")
CAN = CanWheelsSettings(interface="socketcan", channel="can0", mapping="generic_wheel", bit_rate=500_000)
SECOND = 1_000_000_000
DAY = dt.date(2026, 11, 21)


def levels(findings: list[Finding]) -> list[Level]:
    return [finding.level for finding in findings]


def reception(
    *samples: Sample,
    settings: AnyDeviceSettings = COMPASS,
    rejected: Mapping[str, int] | None = None,
    accepted: int | None = None,
    breaks: int = 0,
    start_s: float | None = None,
    pause_s: float = 0.005,
) -> Reception:
    health = Health(
        device="compass",
        state=DeviceState.STREAMING,
        rate_hz=10.0,
        age_s=0.05,
        accepted=len(samples) if accepted is None else accepted,
        rejected=rejected or {},
        breaks=breaks,
        sent=0,
        send_failures=0,
        last_link_reason="pulled" if breaks else "",
    )
    first_ns = samples[0].t_ns if samples else 0
    start_ns = first_ns if start_s is None else nanoseconds(start_s)
    return Reception("compass", settings, start_ns, 2 * SECOND, pause_s, samples, (), health)


def headings(*times_s: float) -> tuple[HeadingSample, ...]:
    magnetic = HeadingReference.MAGNETIC
    return tuple(
        HeadingSample(device="compass", t_ns=nanoseconds(t), heading_rad=0.0, reference=magnetic)
        for t in times_s
    )


# What was received


def test_a_stream_is_counted_by_its_intervals() -> None:
    stream = stream_of([nanoseconds(t) for t in (1.0, 1.1, 1.2, 1.7)], SECOND, nanoseconds(1.8))
    assert stream.rate_hz == pytest.approx(3 / 0.7)
    assert stream.silence_s == pytest.approx(0.5)
    assert stream_of([5], 5, 7).rate_hz == 0.0


@pytest.mark.parametrize(
    "times_s", [np.linspace(1.97, 1.99, 200), np.full(200, 1.99), np.linspace(0, 0.02, 200)]
)
def test_a_burst_from_a_buffer_is_no_rate(times_s: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    """Two seconds of a sensor at 100 Hz, read at once by a program that got no processor time before."""
    stream = stream_of([nanoseconds(t) for t in times_s], 0, 2 * SECOND)
    assert stream.rate_hz == pytest.approx(100.0, rel=0.02)
    assert stream.silence_s > 1.9
    assert stream.is_burst
    assert not stream_of([nanoseconds(t) for t in np.linspace(0, 2, 201)], 0, 2 * SECOND).is_burst


@pytest.mark.parametrize(
    ("pause_s", "cause"),
    [(1.9, "the doctor itself got no processor time for 1.900 s"), (0.005, "waited in a buffer")],
)
def test_a_burst_is_reported_as_one(pause_s: float, cause: str) -> None:
    times_s = np.linspace(1.96, 1.98, 200)
    received = reception(*headings(*times_s), start_s=0.0, pause_s=pause_s)
    (finding,) = check_streams(received, [HEADING], is_required=True)
    assert finding.level is Level.WARNING
    silence, burst = finding.what.split("; ")
    assert silence == "heading: silent for 1.960 s, the limit max_age_s is 0.18 s"
    assert burst.startswith("200 samples came in one burst of 0.020 s, ")
    assert cause in finding.cause


def test_a_doctor_without_processor_time_does_not_judge_the_rate() -> None:
    (finding,) = check_streams(reception(*headings(1.1, 1.9), pause_s=0.7), [HEADING], is_required=True)
    assert finding.level is Level.WARNING
    assert "the doctor itself got no processor time for 0.700 s" in finding.cause


HEADING = Part(HeadingSample, None, "heading")


@pytest.mark.parametrize(
    ("times_s", "is_required", "level", "what"),
    [
        ((1.7, 1.8, 1.9), True, Level.OK, "10.0 Hz, newest 50 ms old"),
        ((1.4, 1.8, 1.9), True, Level.PROBLEM, "heading: 4.0 Hz, required are 5.6 Hz"),
        ((1.4, 1.8, 1.9), False, Level.WARNING, "heading: 4.0 Hz"),
        ((1.3, 1.35, 1.4, 1.45, 1.5, 1.9), True, Level.WARNING, "heading: silent for 0.400 s"),
        ((1.7, 1.71, 1.72), True, Level.WARNING, "heading: silent for 0.280 s"),
        ((1.9,), True, Level.PROBLEM, "heading: 0.0 Hz"),
    ],
)
def test_rates_and_silences(times_s: tuple[float, ...], is_required: bool, level: Level, what: str) -> None:
    (finding,) = check_streams(reception(*headings(*times_s)), [HEADING], is_required=is_required)
    assert (finding.level, finding.what[: len(what)]) == (level, what)


def test_the_suggested_age_limit_is_enough() -> None:
    (finding,) = check_streams(reception(*headings(1.0, 1.5, 2.0)), [HEADING], is_required=True)
    assert finding.fix.endswith("set max_age_s = 0.9")


def test_a_role_needs_its_own_kind_of_sample() -> None:
    rate = RateSample(device="compass", t_ns=1, rate_z_rad_s=0.0)
    (finding,) = check_streams(reception(rate), [HEADING], is_required=True)
    assert finding.what == "samples arrive, but no heading"


def test_a_broken_link_is_a_problem() -> None:
    assert check_breaks(reception()) == []
    assert "broke while listening: pulled" in check_breaks(reception(breaks=2))[0].what


@pytest.mark.parametrize(
    ("rejected", "accepted", "level"),
    [
        ({"checksum": 2}, 100, None),
        ({"checksum": 3}, 100, Level.WARNING),
        ({"checksum": 3}, 1000, None),
        ({"other_sentence": 500}, 100, None),
        ({"motor_fault": 1}, 100, Level.PROBLEM),
        ({"never_heard_of": 50}, 100, Level.WARNING),
        ({"speed_contradicts_position": 1}, 1000, Level.PROBLEM),
        ({"negative_as_unsigned": 1}, 1000, Level.PROBLEM),
        ({"position_ambiguous": 1}, 1000, Level.PROBLEM),
        ({"checksum": 50}, 0, None),
    ],
)
def test_rejections_beside_good_data(rejected: dict[str, int], accepted: int, level: Level | None) -> None:
    findings = check_rejections(reception(rejected=rejected, accepted=accepted))
    assert levels(findings) == ([] if level is None else [level])
    assert all("{" not in finding.fix for finding in findings)


def test_a_silent_board_is_probably_off() -> None:
    (finding,) = check_no_data(
        reception(settings=RobotinoBoardSettings(type="robotino_board", port="/dev/x"))
    )
    assert finding.fix.startswith("switch the rover on")


def test_foreign_can_traffic_only_is_a_wrong_mapping() -> None:
    (finding,) = check_no_data(reception(settings=CAN, rejected={"other_traffic": 9}))
    assert "none that the mapping contains" in finding.cause
    assert "[devices.compass]" in finding.fix


def test_a_watchdog_that_misses_set_points_is_no_problem_while_nobody_drives() -> None:
    sample = FaultSample(device="compass", t_ns=1, code=8, text="watchdog: setpoints missing")
    (finding,) = check_faults(reception(sample), bumper_stops=True)
    assert finding.level is Level.WARNING
    assert "normal here" in finding.cause


def test_faults_active_and_over() -> None:
    def fault(wheel: int | None, code: int, text: str) -> FaultSample:
        return FaultSample(device="compass", t_ns=1, wheel=wheel, code=code, text=text)

    samples = (
        fault(1, 8, "overcurrent"),
        fault(2, 4, "hot"),
        fault(2, 0, ""),
        fault(None, 32, "CAN bus: no acknowledge"),
    )
    first, second, third = check_faults(reception(*samples), bumper_stops=True)
    assert (first.level, first.what) == (Level.PROBLEM, "wheel 1: fault 8 (overcurrent)")
    assert (second.level, second.what) == (Level.WARNING, "wheel 2: fault 4 (hot), now cleared")
    assert "60 ohm" in third.fix


def test_a_pressed_bumper_matters_only_where_it_stops_the_rover() -> None:
    pressed = reception(
        BumperSample(device="compass", t_ns=1, pressed=True),
        PowerSample(device="compass", t_ns=1, voltage_v=24.06),
    )
    assert levels(check_faults(pressed, bumper_stops=True)) == [Level.WARNING, Level.OK]
    (supply,) = check_faults(pressed, bumper_stops=False)
    assert supply.what == "24.1 V"


def frames(rate_hz: float, age_s: float | None) -> Reception:
    settings = CameraSettings(
        type="camera", source="v4l2", path="/dev/video0", width=64, height=48, frame_rate_hz=10
    )
    image = np.zeros((0, 0), np.uint8)
    samples = [
        FrameSample(
            device="compass",
            t_ns=(t_ns := nanoseconds(1 + index / rate_hz)),
            image=image,
            t_capture_ns=None if age_s is None else t_ns - nanoseconds(age_s),
            index=index,
        )
        for index in range(8)
    ]
    return reception(*samples, settings=settings)


@pytest.mark.parametrize(
    ("rate_hz", "age_s", "level", "what"),
    [
        (10.0, 0.03, Level.OK, "10.0 frames per second, at most 30 ms"),
        (5.0, 0.03, Level.WARNING, "5.0 frames per second, configured are 10"),
        (10.0, None, Level.WARNING, "no usable capture times"),
        (10.0, -0.2, Level.WARNING, "no usable capture times: up to -0.200 s"),
        (10.0, 7.0, Level.WARNING, "no usable capture times: up to 7.000 s"),
    ],
)
def test_frames(rate_hz: float, age_s: float | None, level: Level, what: str) -> None:
    record = frames(rate_hz, age_s)
    assert isinstance(record.settings, CameraSettings)
    (finding,) = check_frames(record, record.settings)
    assert (finding.level, finding.what[: len(what)]) == (level, what)


def test_slow_frames_of_a_camera_are_no_reason_for_a_rate_that_it_does_not_offer() -> None:
    record = frames(5.0, 0.03)
    assert isinstance(record.settings, CameraSettings)
    (finding,) = check_frames(record, record.settings)
    assert "next lower rate of `v4l2-ctl --list-formats-ext -d /dev/video0`" in finding.fix
    folder = record.settings.model_copy(update={"source": "folder", "path": "frames"})
    (finding,) = check_frames(record, folder)
    assert "v4l2" not in finding.fix


@pytest.mark.parametrize(
    ("speed", "expected"), [(1.0, [Level.OK]), (1.1, [Level.WARNING]), (0.0, [Level.WARNING]), (None, [])]
)
def test_device_clock(speed: float | None, expected: list[Level]) -> None:
    samples = [
        PowerSample(
            device="compass",
            t_ns=index * SECOND // 10,
            t_device_ns=None
            if speed is None
            else round(index * speed * SECOND / 10)
            if index
            else -99 * SECOND,
            voltage_v=24.0,
        )
        for index in range(15)
    ]
    assert levels(check_device_clock(reception(*samples))) == expected


def test_canopen_drives_that_were_never_configured_are_no_problem() -> None:
    drives = CanopenWheelsSettings.model_validate(
        {
            "interface": "socketcan",
            "channel": "can0",
            "wheel": [{"node": 1}],
            "counts_per_motor_turn": 4096,
            "gear_ratio": 50.0,
        }
    )
    (silent,) = check_no_data(reception(settings=drives))
    assert silent.level is Level.PROBLEM
    assert silent.what == "nothing arrives"
    beating = replace(reception(settings=drives), arrivals=(Received(0, b"heartbeat"),))
    (finding,) = check_no_data(beating)
    assert finding.level is Level.WARNING
    assert finding.what == "heartbeats arrive, but no measurements"


def test_frames_stamped_less_than_a_millisecond_ahead_have_usable_capture_times() -> None:
    record = frames(10.0, -0.0005)
    assert isinstance(record.settings, CameraSettings)
    (finding,) = check_frames(record, record.settings)
    assert finding.level is Level.OK


@pytest.mark.parametrize("device_type", ["camera", "overhead_camera"])
def test_a_camera_with_the_clock_of_another_computer_is_explained(device_type: str) -> None:
    advice = advice_for("stamp_future", device_type)
    assert "later than this computer's clock" in advice.cause
    assert advice.level is Level.PROBLEM
