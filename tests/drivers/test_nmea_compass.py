"""NMEA 0183 compasses: golden sentences, signs, refusals, framing, corruption, real captures."""

import json
import math
from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.program.fuzz_parsers import held_bytes
from drivers.angles import compass_deg_from_yaw, wrap_rad, yaw_from_compass_deg
from drivers.driver import Rejection
from drivers.errors import ConfigError
from drivers.heading_calibration import DeviationTable
from drivers.link import Received
from drivers.nmea import LONGEST_SENTENCE, encode_sentence
from drivers.nmea_compass.codec import NmeaCompassCodec
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.samples import AttitudeSample, HeadingSample, RateSample, Sample

GOLDEN = [
    b"$HCHDG,98.3,0.0,E,12.6,W*57\r\n",
    b"$HCHDM,238.4,M*24\r\n",
    b"$HEHDT,274.07,T*19\r\n",
    b"$GNTHS,244.28,A*11\r\n",
    encode_sentence("TIROT,-12.5,A"),
    encode_sentence("PASHR,130533.620,0.311,T,-80.467,-1.395,,0.066,0.067,0.215,2,3"),
    b"$IIXDR,C,,C,AIRTEMP,A,-1.0,D,HEEL,A,2.9,D,TRIM,P,,B,BARO,A,-3.9,D,RUDDER*29\r\n",
]


def decode(data: bytes, codec: NmeaCompassCodec | None = None) -> Sequence[Sample | Rejection]:
    return (codec or NmeaCompassCodec("compass")).decode(Received(7, data))


def sentence(body: str) -> Sequence[Sample | Rejection]:
    return decode(encode_sentence(body))


def headings(results: Sequence[Sample | Rejection]) -> list[tuple[float, str]]:
    """Return compass headings in deg, free of rounding dust, with their references."""
    return [
        (round(compass_deg_from_yaw(result.heading_rad), 9) % 360, result.reference.value)
        for result in results
        if isinstance(result, HeadingSample)
    ]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (b"$HCHDG,98.3,0.0,E,12.6,W*57", [(98.3, "magnetic"), (85.7, "true")]),
        (b"$SDHDG,229.8,,,1.3,E*36", [(229.8, "magnetic"), (231.1, "true")]),
        (b"$HCHDM,238.4,M*24", [(238.4, "magnetic")]),
        (b"$HEHDT,274.07,T*19", [(274.07, "true")]),
        (b"$GNTHS,244.28,A*11", [(244.28, "true")]),
        (b"$HCHDM,238.4,M,*08", [(238.4, "magnetic")]),
        (b"$HCHDG,238.4,*63", [(238.4, "magnetic")]),
        (b"$HCHDG,238.4*4F", [(238.4, "magnetic")]),
        (b"$HEHDT,360.0,T*2A", [(0.0, "true")]),
    ],
)
def test_golden_headings(line: bytes, expected: list[tuple[float, str]]) -> None:
    results = decode(line + b"\r\n")
    assert headings(results) == expected
    assert all(isinstance(result, Sample) and result.t_ns == 7 for result in results)


def test_encoder_reproduces_published_sentences() -> None:
    assert encode_sentence("HCHDG,98.3,0.0,E,12.6,W") == b"$HCHDG,98.3,0.0,E,12.6,W*57\r\n"
    assert encode_sentence("HCHDM,238.4,M") == b"$HCHDM,238.4,M*24\r\n"
    assert encode_sentence("HEHDT,274.07,T") == b"$HEHDT,274.07,T*19\r\n"


@pytest.mark.parametrize(
    ("compass_deg", "yaw_rad"), [(0.0, math.pi / 2), (90.0, 0.0), (180.0, -math.pi / 2), (270.0, -math.pi)]
)
def test_compass_points_become_east_north_up_yaw(compass_deg: float, yaw_rad: float) -> None:
    (sample,) = sentence(f"HEHDT,{compass_deg:.1f},T")
    assert isinstance(sample, HeadingSample)
    assert sample.heading_rad == pytest.approx(yaw_rad, abs=1e-12)


@given(st.floats(-1e6, 1e6))
def test_angles_stay_in_their_half_open_ranges(angle: float) -> None:
    assert -math.pi <= wrap_rad(angle) < math.pi
    assert -math.pi <= yaw_from_compass_deg(angle) < math.pi
    assert 0.0 <= compass_deg_from_yaw(angle) < 360.0
    assert math.cos(wrap_rad(angle)) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(yaw_from_compass_deg(angle)) == pytest.approx(math.cos(math.radians(angle)), abs=1e-9)


@pytest.mark.parametrize("angle", [math.pi, -math.pi, 3 * math.pi, math.nextafter(-math.pi, -4), -1e-20])
def test_angle_ranges_at_their_ends(angle: float) -> None:
    assert -math.pi <= wrap_rad(angle) < math.pi
    assert -math.pi <= yaw_from_compass_deg(90.0 + math.degrees(angle)) < math.pi
    assert 0.0 <= compass_deg_from_yaw(math.pi / 2 + angle) < 360.0


def test_compass_heading_just_west_of_north_does_not_round_to_360() -> None:
    assert compass_deg_from_yaw(math.nextafter(math.pi / 2, 2.0)) == 0.0


@given(
    heading=st.integers(0, 3599),
    deviation=st.none() | st.integers(-300, 300),
    variation=st.none() | st.integers(-300, 300),
)
def test_hdg_round_trip(heading: int, deviation: int | None, variation: int | None) -> None:
    def signed(value: int | None) -> str:
        return "," if value is None else f"{abs(value) / 10:.1f},{'E' if value >= 0 else 'W'}"

    results = sentence(f"HCHDG,{heading / 10:.1f},{signed(deviation)},{signed(variation)}")
    magnetic = (heading + (deviation or 0)) / 10
    expected = {"magnetic": magnetic}
    if variation is not None:
        expected["true"] = magnetic + variation / 10
    assert [reference for _, reference in headings(results)] == list(expected)
    for heading_deg, reference in headings(results):
        assert math.remainder(heading_deg - expected[reference], 360) == pytest.approx(0, abs=1e-9)


def test_turn_to_starboard_is_a_negative_rate() -> None:
    (sample,) = sentence("TIROT,60.0,A")
    assert isinstance(sample, RateSample)
    assert sample.rate_z_rad_s == pytest.approx(-math.radians(1.0))
    assert sample.rate_x_rad_s is None


def test_pashr_gives_attitude_and_true_heading() -> None:
    attitude, heading = sentence("PASHR,235960.000,90.0,T,-10.0,5.0,,0.1,0.1,0.1,1,1")  # a leap second
    assert isinstance(attitude, AttitudeSample)
    assert attitude.roll_rad == pytest.approx(math.radians(-10.0))
    assert attitude.pitch_rad == pytest.approx(math.radians(-5.0))  # bow up on the wire, nose down here
    assert headings([heading]) == [(90.0, "true")]


def test_pashr_without_heading_still_gives_attitude() -> None:
    (attitude,) = sentence("PASHR,,,T,1.0,2.0,,,,,0,1")
    assert isinstance(attitude, AttitudeSample)
    assert attitude.roll_rad == pytest.approx(math.radians(1.0))


@pytest.mark.parametrize(
    ("body", "roll_deg", "pitch_deg"),
    [
        ("IIXDR,A,5.0,D,PITCH,A,-3.0,D,ROLL", -3.0, -5.0),
        ("IIXDR,A,5.0,D,Pitch", None, -5.0),
        ("IIXDR,C,,C,AIRTEMP,A,-1.0,D,HEEL,A,2.9,D,TRIM,P,,B,BARO,A,-3.9,D,RUDDER", -1.0, -2.9),
    ],
)
def test_xdr_attitude(body: str, roll_deg: float | None, pitch_deg: float | None) -> None:
    (sample,) = sentence(body)
    assert isinstance(sample, AttitudeSample)
    for measured, expected in ((sample.roll_rad, roll_deg), (sample.pitch_rad, pitch_deg)):
        assert measured == (None if expected is None else pytest.approx(math.radians(expected)))


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("GPHDT,,T", "empty"),
        ("HCHDG,,,,1.3,E", "empty"),
        ("HCHDM", "empty"),
        ("IIXDR,A,,D,PITCH", "empty"),
        ("PASHR,,,,,,,,,,0", "empty"),
        ("GNTHS,,V", "invalid_mode"),
        ("GNTHS,12.0,E", "invalid_mode"),
        ("GNTHS,12.0,S", "invalid_mode"),
        ("TIROT,12.0,V", "invalid_mode"),
        ("HEHDT,360.1,T", "range"),
        ("HEHDT,-0.1,T", "range"),
        ("HEHDT,nan,T", "range"),
        ("HEHDT,inf,T", "range"),
        ("HEHDT,1e9,T", "range"),
        ("TIROT,200000,A", "range"),
        ("IIXDR,A,91.0,D,PITCH", "range"),
        ("HCHDG,10.0,0.0,E,-12.6,W", "range"),
        ("HEHDT,12.0,M", "format"),
        ("HCHDM,12.0,T", "format"),
        ("HEHDT,twelve,T", "format"),
        ("HCHDG,10.0,0.0,E,12.6,X", "format"),
        ("HCHDG,10.0,1.0", "format"),
        ("PASHR,1,2", "format"),
        ("PASHR,1,2,M,1.0,1.0", "format"),
        ("PASHR,ATT,1,2,3,4", "other_sentence"),
        ("IIXDR,C,20.0,C,AIRTEMP", "other_sentence"),
        ("IIXDR,A,5.0,R,PITCH", "other_sentence"),
        ("IIXDR,V,5.0,D,ROLL", "other_sentence"),
        ("GPGGA,,,,,,0,,,,M,,M,,", "other_sentence"),
        ("PSTI,036,003832.000,290322,244.28,2.77,0.00,R", "other_sentence"),
        ("PHDG,1.0", "other_sentence"),
        ("X", "other_sentence"),
    ],
)
def test_refusals_are_named(body: str, reason: str) -> None:
    assert list(sentence(body)) == [Rejection(reason)]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"$HCHDM,238.4,M*25", "checksum"),
        (b"$HCHDM,238.4,M", "checksum"),
        (b"$HCHDM,238.4,M*2", "framing"),
        (b"$HCHDM,238.4,M*24x", "framing"),
        (b"$HCHDM,23\x008.4,M*24", "framing"),  # a NUL does not change the checksum
        (b"$HCHDM,238.4,M\xc3\xa9*24", "framing"),
        (b"HCHDM,238.4,M*24", "framing"),
        (b"# a comment", "framing"),
        (b"\xff\x00\x80", "framing"),
        (b"$", "framing"),
        (b"$HCHDM," + b"0" * LONGEST_SENTENCE + b"238.4,M*24", "framing"),
    ],
)
def test_broken_lines_are_named(line: bytes, reason: str) -> None:
    assert list(decode(line + b"\r\n")) == [Rejection(reason)]


# Headings that another device passes on: field tables of NMEA 0183


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("SDVHW,273.1,T,278.7,M,,N,,K", [(273.1, "true"), (278.7, "magnetic")]),
        ("VWVHW,,T,12.0,M,4.2,N,7.8,K", [(12.0, "magnetic")]),
        ("IIVHW,12.5,T,,,4.2,N,,", [(12.5, "true")]),
        ("RAOSD,35.1,A,36.0,P,10.2,P,15.3,0.1,N", [(35.1, "true")]),
    ],
)
def test_heading_of_a_speed_log_or_radar(body: str, expected: list[tuple[float, str]]) -> None:
    assert headings(decode(encode_sentence(body))) == expected


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("VWVHW,,T,,M,4.2,N,7.8,K", "other_sentence"),  # a speed log without a compass
        ("VWVHW,12.5,M,13.0,M,4.2,N,7.8,K", "format"),
        ("VWVHW,12.5,T,13.0,T,4.2,N,7.8,K", "format"),
        ("VWVHW,412.5,T,,M,4.2,N,7.8,K", "range"),
        ("RAOSD,35.1,V,36.0,P,10.2,P,15.3,0.1,N", "invalid_mode"),
    ],
)
def test_what_a_speed_log_or_radar_does_not_know_is_not_read(body: str, reason: str) -> None:
    assert list(decode(encode_sentence(body))) == [Rejection(reason)]


def test_a_compass_counts_more_than_what_passes_its_heading_on() -> None:
    codec = NmeaCompassCodec("compass")
    log = encode_sentence("VWVHW,12.5,T,,M,4.2,N,7.8,K")
    assert len(headings(decode(log, codec))) == 1
    assert headings(decode(encode_sentence("HEHDT,20.0,T"), codec)) == [(20.0, "true")]
    assert list(decode(log, codec)) == [Rejection("other_sentence")]
    codec.reset()
    assert len(headings(decode(log, codec))) == 1


def test_reported_speed_log_has_the_heading(shared_data: Path) -> None:
    data = (shared_data / "field_reports" / "serial" / "speed_log_with_heading.nmea").read_bytes()
    found = headings(decode(data))
    assert len(found) == 100
    true = [heading for heading, reference in found if reference == "true"]
    magnetic = [heading for heading, reference in found if reference == "magnetic"]
    assert (min(true), max(true), min(magnetic), max(magnetic)) == (273.1, 273.7, 278.7, 279.3)


@pytest.mark.parametrize(
    "line",
    [
        b"#AGRICA,70,GPS,FINE,2300,100000000,0,0,18,10;GNSS,232,24*00000000",
        b"#BESTPOSA,COM1,0,83.5,FINESTEERING,1419,336148.000;SOL_COMPUTED" + b",0.0" * 200 + b"*6f08fa22",
        b"!AIVDM,1,1,,B,177KQJ5000G?tO`K>RA1wUbN0TKH,0*5C",
        b"%GPS,0123456789*hh",
    ],
)
@pytest.mark.parametrize("size", [7, 4000])
def test_text_of_another_kind_is_not_noise(line: bytes, size: int) -> None:
    codec, data = NmeaCompassCodec("compass"), line + b"\r\n" + encode_sentence("HEHDT,20.0,T")
    results = [
        each for begin in range(0, len(data), size) for each in decode(data[begin : begin + size], codec)
    ]
    assert results[0] == Rejection("other_sentence")
    assert headings(results[1:]) == [(20.0, "true")]


def test_checksum_may_be_missing_but_never_wrong() -> None:
    codec = NmeaCompassCodec("compass", require_checksum=False)
    assert headings(decode(b"$HCHDM,238.4,M\r\n", codec)) == [(238.4, "magnetic")]
    assert list(decode(b"$HCHDM,238.4,M*25\r\n", codec)) == [Rejection("checksum")]


def test_sentence_is_found_behind_noise_and_behind_a_lost_line_end() -> None:
    for before in (b"\x00\xff\x80garbage", b"$HCHDM,238.", b"\r\r\n\n"):
        results = decode(before + b"$HEHDT,274.07,T*19\r\n")
        assert headings(results) == [(274.07, "true")]


@pytest.mark.parametrize("line_end", [b"\r\n", b"\n", b"\r"])
def test_any_line_end_will_do(line_end: bytes) -> None:
    assert len(headings(decode(b"$HEHDT,274.07,T*19" + line_end))) == 1


def test_split_at_every_byte_changes_nothing() -> None:
    stream = (
        b"noise" + GOLDEN[0] + b"\x00\r\n" + b"".join(GOLDEN) + b"$HCHDM,2" + GOLDEN[2] + b"x" * 600 + b"\n"
    )
    whole = list(decode(stream))
    assert Counter(type(result) for result in whole)[HeadingSample] == 9
    for cut in range(len(stream) + 1):
        codec = NmeaCompassCodec("compass")
        assert [*decode(stream[:cut], codec), *decode(stream[cut:], codec)] == whole
    codec = NmeaCompassCodec("compass")
    assert [result for byte in stream for result in decode(bytes([byte]), codec)] == whole


def test_reset_forgets_half_a_sentence() -> None:
    codec = NmeaCompassCodec("compass")
    assert list(decode(b"$HCHDM,238.4", codec)) == []
    codec.reset()
    assert list(decode(b",M*24\r\n", codec)) == [Rejection("framing")]


def test_flood_without_line_end_is_dropped() -> None:
    codec = NmeaCompassCodec("compass")
    for _ in range(100):
        assert list(decode(b"$" * 10_000, codec)) == []
        assert held_bytes(codec) <= held_bytes(NmeaCompassCodec("compass")) + LONGEST_SENTENCE
    results = decode(b"\r\n" + GOLDEN[2], codec)
    assert results[0] == Rejection("framing")
    assert headings(results) == [(274.07, "true")]


@pytest.mark.parametrize("frame", GOLDEN)
def test_no_single_bit_error_changes_a_value(frame: bytes) -> None:
    """Holds for every single-bit error, as the XOR changes; two errors in one bit column can cancel out."""
    whole = list(decode(frame))
    for bit in range(8 * len(frame)):
        flipped = bytearray(frame)
        flipped[bit // 8] ^= 1 << bit % 8
        for result in decode(bytes(flipped) + b"\r\n"):
            assert isinstance(result, Rejection) or result in whole


def test_deviation_table_is_added_before_the_conversion() -> None:
    table = DeviationTable.model_validate(
        {
            "source": "made up",
            "date": "2026-05-04",
            "heading_deg": [0, 90, 180, 270],
            "deviation_deg": [2.0, -4.0, 0.0, 0.0],
        }
    )
    codec = NmeaCompassCodec("compass", deviation_table=table)
    assert headings(decode(encode_sentence("HCHDM,45.0,M"), codec)) == [(44.0, "magnetic")]
    # The device's own deviation comes first, the variation last; true headings are left alone.
    assert headings(decode(encode_sentence("HCHDG,80.0,10.0,E,3.0,W"), codec)) == [
        (86.0, "magnetic"),
        (83.0, "true"),
    ]
    assert headings(decode(encode_sentence("HEHDT,90.0,T"), codec)) == [(90.0, "true")]


def test_settings_build_the_codec(tmp_path: Path) -> None:
    settings = NmeaCompassSettings(port="/dev/null")
    assert settings.data_files() == {}
    assert (settings.type, settings.baud_rate, settings.max_age_s) == ("nmea_compass", 4800, 0.18)
    assert settings.make_codec("compass").decode(Received(1, GOLDEN[1]))
    table = tmp_path / "table.toml"
    table.write_text(
        'source = "made up"\ndate = 2026-05-04\n'
        "heading_deg = [0, 90, 180, 270]\ndeviation_deg = [1, 1, 1, 1]\n"
    )
    settings = NmeaCompassSettings(port="/dev/null", calibration=str(table))
    assert settings.data_files() == {"calibration": (table,)}
    codec = settings.make_codec("compass")
    assert headings(codec.decode(Received(1, GOLDEN[1]))) == [(239.4, "magnetic")]
    with pytest.raises(ConfigError, match=r"missing\.toml"):
        NmeaCompassSettings(port="/dev/null", calibration=str(tmp_path / "missing.toml")).make_codec(
            "compass"
        )


def read_capture(path: Path) -> list[Sample | Rejection]:
    """Decode a capture in chunks of a size that no line has, as a serial port would."""
    codec = NmeaCompassCodec("compass")
    data = path.read_bytes()
    return [result for start in range(0, len(data), 61) for result in decode(data[start : start + 61], codec)]


def without_repeats(values: Sequence[float]) -> list[float]:
    return [value for value, _ in groupby(values)]


@pytest.mark.parametrize(
    ("name", "count"), [("hemi.log", 4), ("skytraq-PX1172RH_DS.log", 9)], ids=["hemi", "skytraq"]
)
def test_capture_agrees_with_gpsd(shared_data: Path, name: str, count: int) -> None:
    folder = shared_data / "heading_captures"
    reports = [
        json.loads(line)
        for line in (folder / f"{name}.chk").read_text(encoding="ascii").splitlines()
        if line.startswith('{"class":"ATT"')
    ]
    theirs = without_repeats([report["heading"] for report in reports])
    measured = headings(read_capture(folder / name))
    ours = without_repeats([heading_deg for heading_deg, _ in measured])
    assert {reference for _, reference in measured} == {"true"}
    assert len(ours) == count
    assert ours == pytest.approx(theirs, abs=1e-6)


def test_capture_of_1457_magnetic_headings(shared_data: Path) -> None:
    folder = shared_data / "heading_captures"
    lines = (folder / "bundg_zeus_9.log.chk").read_text(encoding="ascii").splitlines()
    expected: list[tuple[float, str]] = []
    for fields in (line.split("*")[0].split(",") for line in lines if line.startswith("$SDHDG,")):
        magnetic_deg, variation_deg = float(fields[1]), float(fields[4])
        expected += [(magnetic_deg, "magnetic"), ((magnetic_deg + variation_deg) % 360, "true")]
    results = read_capture(folder / "bundg_zeus_9.log")
    measured = headings(results)
    assert len(measured) == 2 * 1457
    assert [reference for _, reference in measured] == [reference for _, reference in expected]
    assert [heading_deg for heading_deg, _ in measured] == pytest.approx(
        [deg for deg, _ in expected], abs=1e-9
    )
    counts = Counter(result.reason for result in results if isinstance(result, Rejection))
    assert set(counts) == {"other_sentence", "framing"}
    attitudes = [result for result in results if isinstance(result, AttitudeSample)]
    assert len(attitudes) == sum(line.startswith("$IIXDR,") for line in lines)
