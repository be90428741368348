"""NMEA 0183 sentences of compasses and attitude sensors.

Source: NMEA 0183 field tables as published by manufacturers; KVH TracVision manuals for the extra comma
before the checksum in `$HCHDM,238.4,M,*hh` and `$HCHDG,238.4,*hh`; Trimble receiver help for PASHR.
Signs on the wire: headings clockwise from north, deviation and variation with E or W, rate of turn positive
to starboard (clockwise), roll positive port side up, pitch positive bow up.
"""

import math
import re
from collections.abc import Callable, Sequence
from functools import reduce
from operator import xor

from pynmeagps import VALNONE, NMEAReader
from pynmeagps.exceptions import NMEAParseError, NMEATypeError

from drivers.angles import yaw_from_compass_deg
from drivers.driver import Rejection
from drivers.heading_calibration import DeviationTable
from drivers.link import Received
from drivers.samples import AttitudeSample, HeadingReference, HeadingSample, RateSample, Sample

LONGEST_SENTENCE = 255
"""Bytes kept of a line. The standard allows 82; real devices exceed it."""
FASTEST_TURN_DEG_MIN = 120_000.0
"""2000 deg/s, the widest range of the gyroscopes in use."""

HEADING_ADDRESSES = frozenset({"HDG", "HDM", "HDT", "THS", "PASHR"})
LINE_END = re.compile(rb"[\r\n]+")
OTHER_TEXT = re.compile(rb"[#!%][A-Z][0-9A-Z]+,[ -~]*")
"""Logs of Unicore and NovAtel receivers and sentences of AIS, which may stand among those of NMEA 0183."""
BODY_AND_CHECKSUM = re.compile(rb"([ -)+-~]+)(?:\*([0-9A-Fa-f]{2}))?")
PITCH_NAMES = frozenset({"PITCH", "PTCH", "TRIM"})
ROLL_NAMES = frozenset({"ROLL", "HEEL"})


class _RejectedError(Exception):
    """A sentence holds something that must not become a sample; the argument is the rejection's reason."""


def encode_sentence(body: str) -> bytes:
    """Return a sentence with start, checksum and line end, e.g. for the body "HCHDM,238.4,M"."""
    return f"${body}*{reduce(xor, body.encode('ascii'), 0):02X}\r\n".encode("ascii")


class NmeaCompassCodec:
    """Reads HDG, HDM, HDT, THS, VHW, OSD, ROT, XDR and PASHR of any talker; others are "other_sentence".

    HDG and HDM give magnetic headings; HDG gives a true one too when it carries a variation; HDT, THS and
    PASHR give true ones. A speed log (VHW) or radar (OSD) passes on the heading of a compass, later than the
    compass itself: it is read as long as no other sentence brings one. Rejections: "framing", "checksum",
    "format", "empty", "invalid_mode", "range", "other_sentence".

    Args:
        name: Name of the device in the configuration.
        require_checksum: Reject sentences without a checksum.
        deviation_table: Added to magnetic headings, after the deviation that the device reports itself.
    """

    def __init__(
        self, name: str, *, require_checksum: bool = True, deviation_table: DeviationTable | None = None
    ) -> None:
        self._name = name
        self._require_checksum = require_checksum
        self._deviation_table = deviation_table
        self._tail = b""
        self._has_compass = False
        self._readers: dict[str, Callable[[bytes, int], list[Sample]]] = {
            "HDG": self._read_hdg,
            "HDM": self._read_hdm,
            "HDT": self._read_hdt,
            "THS": self._read_ths,
            "ROT": self._read_rot,
            "XDR": self._read_xdr,
            "PASHR": self._read_pashr,
            "VHW": self._read_vhw,
            "OSD": self._read_osd,
        }

    def decode(self, item: Received[bytes]) -> Sequence[Sample | Rejection]:
        """Return the samples and rejections of the lines that `item` completes."""
        *lines, tail = LINE_END.split(self._tail + item.payload)
        self._tail = _shortened(tail)
        results: list[Sample | Rejection] = []
        for line in lines:
            if line:
                results.extend(self._read_line(_shortened(line), item.t_ns))
        return results

    def reset(self) -> None:
        """Forget a half-received line, and which sentences came."""
        self._tail = b""
        self._has_compass = False

    def _read_line(self, line: bytes, t_ns: int) -> Sequence[Sample | Rejection]:
        try:
            body = self._checked_body(line)
            address = body.partition(b",")[0].decode("ascii")
            # Proprietary addresses start with P, all others with a talker of two letters.
            name = address if address.startswith("P") else address[2:]
            reader = self._readers.get(name)
            if reader is None:
                return (Rejection("other_sentence"),)
            samples = reader(body, t_ns)
            self._has_compass |= name in HEADING_ADDRESSES
            return samples
        except _RejectedError as rejected:
            return (Rejection(str(rejected)),)

    def _checked_body(self, line: bytes) -> bytes:
        _, start, sentence = line.rpartition(b"$")
        if OTHER_TEXT.fullmatch(line):
            raise _RejectedError("other_sentence")
        match = BODY_AND_CHECKSUM.fullmatch(sentence)
        if not start or match is None:
            raise _RejectedError("framing")
        body, checksum = match.groups()
        if checksum is None:
            if self._require_checksum:
                raise _RejectedError("checksum")
        elif int(checksum, 16) != reduce(xor, body):
            raise _RejectedError("checksum")
        return body

    def _read_hdg(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = _parse(body)
        reading_deg = _number(fields, "headingM", 0.0, 360.0)
        magnetic_deg = self._corrected(reading_deg + (_east_positive(fields, "deviation") or 0.0))
        samples: list[Sample] = [self._heading(t_ns, magnetic_deg, HeadingReference.MAGNETIC)]
        variation_deg = _east_positive(fields, "variation")
        if variation_deg is not None:
            samples.append(self._heading(t_ns, magnetic_deg + variation_deg, HeadingReference.TRUE))
        return samples

    def _read_hdm(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = _parse(body)
        magnetic_deg = self._corrected(_number(fields, "headingM", 0.0, 360.0))
        _require_letter(fields, "headingMag", "M", "format")
        return [self._heading(t_ns, magnetic_deg, HeadingReference.MAGNETIC)]

    def _read_hdt(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = _parse(body)
        true_deg = _number(fields, "headingT", 0.0, 360.0)
        _require_letter(fields, "headingTu", "T", "format")
        return [self._heading(t_ns, true_deg, HeadingReference.TRUE)]

    def _read_ths(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = _parse(body)
        # Other modes: estimated, manual, simulated, void. Such a heading is not measured.
        _require_letter(fields, "mi", "A", "invalid_mode")
        return [self._heading(t_ns, _number(fields, "headt", 0.0, 360.0), HeadingReference.TRUE)]

    def _read_vhw(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = _parse(body)
        is_true, is_magnetic = fields.get("hdgT", "") != "", fields.get("hdgM", "") != ""
        if self._has_compass or not (is_true or is_magnetic):
            raise _RejectedError("other_sentence")
        samples: list[Sample] = []
        if is_true:
            _require_letter(fields, "hgdTu", "T", "format")
            true_deg = _number(fields, "hdgT", 0.0, 360.0)
            samples.append(self._heading(t_ns, true_deg, HeadingReference.TRUE))
        if is_magnetic:
            _require_letter(fields, "hgdMu", "M", "format")
            magnetic_deg = self._corrected(_number(fields, "hdgM", 0.0, 360.0))
            samples.append(self._heading(t_ns, magnetic_deg, HeadingReference.MAGNETIC))
        return samples

    def _read_osd(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = _parse(body)
        if self._has_compass:
            raise _RejectedError("other_sentence")
        _require_letter(fields, "hdgstate", "A", "invalid_mode")
        return [self._heading(t_ns, _number(fields, "hdg", 0.0, 360.0), HeadingReference.TRUE)]

    def _read_rot(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = _parse(body)
        _require_letter(fields, "valid", "A", "invalid_mode")
        turn_deg_min = _number(fields, "rot", -FASTEST_TURN_DEG_MIN, FASTEST_TURN_DEG_MIN)
        rate_rad_s = -math.radians(turn_deg_min) / 60.0
        return [RateSample(device=self._name, t_ns=t_ns, rate_z_rad_s=rate_rad_s)]

    def _read_xdr(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = _parse(body)
        roll_deg = pitch_deg = None
        for key, transducer in fields.items():
            if not key.startswith("tdrid_"):
                continue
            index = key.removeprefix("tdrid_")
            is_angle = fields.get(f"tdrtype_{index}") == "A" and fields.get(f"dataunit_{index}") == "D"
            if is_angle and str(transducer).upper() in ROLL_NAMES:
                roll_deg = _number(fields, f"data_{index}", -180.0, 180.0)
            elif is_angle and str(transducer).upper() in PITCH_NAMES:
                pitch_deg = _number(fields, f"data_{index}", -90.0, 90.0)
        if roll_deg is None and pitch_deg is None:
            raise _RejectedError("other_sentence")
        return [self._attitude(t_ns, roll_deg, pitch_deg)]

    def _read_pashr(self, body: bytes, t_ns: int) -> list[Sample]:
        # Read by hand: pynmeagps (1.1.8) raises IndexError on an empty time, which PASHR has before the first
        # fix, and rejects the sentence for a leap second; the time is not used here.
        texts = body.decode("ascii").split(",")
        if texts[1:2] and texts[1].isalpha():
            raise _RejectedError("other_sentence")  # $PASHR,ATT,... and similar are other messages
        if len(texts) < 6:
            raise _RejectedError("format")
        names = ("heading", "indicator", "roll", "pitch")
        fields: dict[str, object] = dict(zip(names, texts[2:6], strict=True))
        roll_deg = _number(fields, "roll", -180.0, 180.0)
        pitch_deg = _number(fields, "pitch", -90.0, 90.0)
        samples: list[Sample] = [self._attitude(t_ns, roll_deg, pitch_deg)]
        if fields["heading"] != "":
            true_deg = _number(fields, "heading", 0.0, 360.0)
            _require_letter(fields, "indicator", "T", "format")
            samples.append(self._heading(t_ns, true_deg, HeadingReference.TRUE))
        return samples

    def _corrected(self, reading_deg: float) -> float:
        if self._deviation_table is None:
            return reading_deg
        return reading_deg + self._deviation_table.deviation_at(reading_deg)

    def _heading(self, t_ns: int, heading_deg: float, reference: HeadingReference) -> HeadingSample:
        yaw_rad = yaw_from_compass_deg(heading_deg)
        return HeadingSample(device=self._name, t_ns=t_ns, heading_rad=yaw_rad, reference=reference)

    def _attitude(self, t_ns: int, roll_deg: float | None, pitch_deg: float | None) -> AttitudeSample:
        return AttitudeSample(
            device=self._name,
            t_ns=t_ns,
            roll_rad=None if roll_deg is None else math.radians(roll_deg),
            pitch_rad=None if pitch_deg is None else -math.radians(pitch_deg),
        )


def _shortened(line: bytes) -> bytes:
    """Return the end of a line, where a sentence may be; the begin of other text, which tells its kind."""
    return line[:LONGEST_SENTENCE] if line[:1] in (b"#", b"!", b"%") else line[-LONGEST_SENTENCE:]


def _parse(body: bytes) -> dict[str, object]:
    """Return the fields of a standard sentence by the names that pynmeagps gives them."""
    try:
        message = NMEAReader.parse(body + b"*", validate=VALNONE)  # the checksum has been verified
    except (NMEAParseError, NMEATypeError) as error:
        raise _RejectedError("format") from error
    return {} if message is None else vars(message)


def _number(fields: dict[str, object], key: str, low: float, high: float) -> float:
    text = fields.get(key, "")
    if text == "":
        raise _RejectedError("empty")
    try:
        value = float(str(text))
    except ValueError as error:
        raise _RejectedError("format") from error
    if not low <= value <= high:  # rejects NaN too
        raise _RejectedError("range")
    return value


def _east_positive(fields: dict[str, object], key: str) -> float | None:
    """Return a deviation or variation in deg, or None where the field is empty."""
    if fields.get(key, "") == "":
        return None
    value_deg = _number(fields, key, 0.0, 180.0)
    side = fields.get(f"{key}EW")
    if side not in ("E", "W"):
        raise _RejectedError("format")
    return value_deg if side == "E" else -value_deg


def _require_letter(fields: dict[str, object], key: str, letter: str, reason: str) -> None:
    if fields.get(key) != letter:
        raise _RejectedError(reason)
