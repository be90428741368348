"""GNSS receivers: sentences in, pose fixes without yaw out."""

import math
from datetime import time

import pytest
from pydantic import ValidationError

from drivers.driver import Rejection
from drivers.link import Received
from drivers.nmea import RejectedError, encode_sentence, number
from drivers.nmea_gnss.codec import NmeaGnssCodec
from drivers.nmea_gnss.settings import NmeaGnssSettings
from drivers.samples import UNKNOWN_YAW_STD_RAD, PoseFixSample

SECOND_NS = 1_000_000_000
PLACE = "4800.0000000,N,01100.0000000,E"
NORTH = "4800.0100000,N,01100.0000000,E"
"""0.01 minutes, 18.5 m, north of PLACE; a minute of latitude is 1853 m there (WGS 84)."""


def codec(**changes: object) -> NmeaGnssCodec:
    settings = {"port": "gnss", "correlation_s": 0.0, **changes}
    return NmeaGnssCodec("gnss", NmeaGnssSettings.model_validate(settings))


def gga(second: int, place: str = PLACE, quality: object = 4, dilution: float = 0.8) -> str:
    return f"GNGGA,1200{second:02d}.00,{place},{quality},12,{dilution},500.0,M,47.0,M,,"


def read(reader: NmeaGnssCodec, *bodies: str, period_ns: int = SECOND_NS) -> list[PoseFixSample | str]:
    results: list[PoseFixSample | str] = []
    for index, body in enumerate(bodies, start=1):
        for each in reader.decode(Received(index * period_ns, encode_sentence(body))):
            assert isinstance(each, PoseFixSample | Rejection)
            results.append(each.reason if isinstance(each, Rejection) else each)
    return results


def test_a_position_is_a_fix_without_yaw_from_the_first_one() -> None:
    first, second = read(codec(antenna_x_m=0.3, antenna_y_m=-0.2), gga(0), gga(1, NORTH))
    assert isinstance(first, PoseFixSample)
    assert isinstance(second, PoseFixSample)
    assert (first.x_m, first.y_m) == (0.0, 0.0)
    assert second.x_m == pytest.approx(0.0, abs=1e-6)
    assert second.y_m == pytest.approx(18.53, abs=0.01)
    assert second.yaw_std_rad >= UNKNOWN_YAW_STD_RAD
    assert (second.arm_x_m, second.arm_y_m) == (0.3, -0.2)
    assert second.t_ns - second.t_capture_ns == 100_000_000


def test_a_given_origin_holds() -> None:
    (fix,) = read(codec(origin_latitude_deg=48.0, origin_longitude_deg=11.0), gga(0, NORTH))
    assert isinstance(fix, PoseFixSample)
    assert fix.y_m == pytest.approx(18.53, abs=0.01)
    with pytest.raises(ValidationError, match="give both"):
        codec(origin_latitude_deg=48.0)


@pytest.mark.parametrize(
    ("quality", "dilution", "std_m"),
    [(1, 2.0, 6.0), (2, 1.0, 1.0), (5, 1.0, 0.4), (4, 0.5, 0.02)],
)
def test_the_quality_is_the_deviation_where_the_receiver_sends_none(
    quality: int, dilution: float, std_m: float
) -> None:
    (fix,) = read(codec(), gga(0, quality=quality, dilution=dilution))
    assert isinstance(fix, PoseFixSample)
    assert fix.position_std_m == pytest.approx(std_m)


def test_the_deviation_of_the_receiver_holds_until_the_quality_changes() -> None:
    gst = "GNGST,120000.00,,,,,0.050,0.070,0.1"
    fixes = [
        each for each in read(codec(), gga(0), gst, gga(1), gga(2, quality=1)) if not isinstance(each, str)
    ]
    assert [fix.position_std_m for fix in fixes] == pytest.approx([0.02, 0.07, 3.0])


def test_fixes_that_follow_fast_are_less_certain_by_their_correlation() -> None:
    bodies = [gga(second) for second in range(3)]
    *_, fix = read(codec(correlation_s=5.0), *bodies, period_ns=SECOND_NS // 10)
    assert isinstance(fix, PoseFixSample)
    assert fix.position_std_m == pytest.approx(0.02 * math.sqrt(100.0))


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (gga(1, ",,,", 0), "no_fix"),
        (gga(1, quality=6), "invalid_mode"),
        (gga(1, quality=8), "invalid_mode"),
        (gga(0), "stale"),
        (gga(1, quality=1, dilution=50.0), "uncertain"),
        ("GNGGA,120001.00,,,,,4,12,0.8,500.0,M,47.0,M,,", "empty"),
        (f"GNRMC,120001.00,A,{PLACE},0.5,84.4,010126,,,A", "other_sentence"),
        ("GNGSV,1,1,00", "other_sentence"),
    ],
)
def test_what_is_no_position_is_rejected(body: str, reason: str) -> None:
    assert read(codec(), gga(0), body)[1:] == [reason]


@pytest.mark.parametrize(
    ("mode", "expected"), [("R", 0.02), ("A", 3.0), ("", 3.0), ("E", "invalid_mode"), ("N", "no_fix")]
)
def test_rmc_alone_gives_positions(mode: str, expected: object) -> None:
    (result,) = read(codec(), f"GNRMC,120001.00,A,{PLACE},0.5,84.4,010126,,,{mode}")
    assert (result if isinstance(result, str) else result.position_std_m) == expected


def test_a_receiver_that_says_void_has_no_fix() -> None:
    assert read(codec(), "GNRMC,120001.00,V,,,,,,,010126,,,N") == ["no_fix"]


def test_a_field_of_another_kind_is_no_number() -> None:
    """A quantity of a sentence that the library takes for a time of day."""
    with pytest.raises(RejectedError, match="format"):
        number({"lat": time(12)}, "lat", -90.0, 90.0)
