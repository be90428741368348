"""NMEA 0183 sentences of compasses and attitude sensors.

Source: NMEA 0183 field tables as published by manufacturers; KVH TracVision manuals for the extra comma
before the checksum in `$HCHDM,238.4,M,*hh` and `$HCHDG,238.4,*hh`; Trimble receiver help for PASHR.
Signs on the wire: headings clockwise from north, deviation and variation with E or W, rate of turn positive
to starboard (clockwise), roll positive port side up, pitch positive bow up.
"""

import math
from collections.abc import Callable, Sequence

from drivers.angles import yaw_from_compass_deg
from drivers.heading_calibration import DeviationTable
from drivers.nmea import RejectedError, SentenceCodec, number, parse, require_letter
from drivers.samples import AttitudeSample, HeadingReference, HeadingSample, RateSample, Sample

FASTEST_TURN_DEG_MIN = 120_000.0
"""2000 deg/s, the widest range of the gyroscopes in use."""

HEADING_ADDRESSES = frozenset({"HDG", "HDM", "HDT", "THS", "PASHR"})
PITCH_NAMES = frozenset({"PITCH", "PTCH", "TRIM"})
ROLL_NAMES = frozenset({"ROLL", "HEEL"})


class NmeaCompassCodec(SentenceCodec):
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
        super().__init__(require_checksum=require_checksum)
        self._name = name
        self._deviation_table = deviation_table
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

    def reset(self) -> None:
        """Forget a half-received line, and which sentences came."""
        super().reset()
        self._has_compass = False

    def read_sentence(self, name: str, body: bytes, t_ns: int) -> Sequence[Sample]:
        """Return the samples of a sentence, see `SentenceCodec`."""
        reader = self._readers.get(name)
        if reader is None:
            raise RejectedError("other_sentence")
        samples = reader(body, t_ns)
        self._has_compass |= name in HEADING_ADDRESSES
        return samples

    def _read_hdg(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = parse(body)
        reading_deg = number(fields, "headingM", 0.0, 360.0)
        magnetic_deg = self._corrected(reading_deg + (_east_positive(fields, "deviation") or 0.0))
        samples: list[Sample] = [self._heading(t_ns, magnetic_deg, HeadingReference.MAGNETIC)]
        variation_deg = _east_positive(fields, "variation")
        if variation_deg is not None:
            samples.append(self._heading(t_ns, magnetic_deg + variation_deg, HeadingReference.TRUE))
        return samples

    def _read_hdm(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = parse(body)
        magnetic_deg = self._corrected(number(fields, "headingM", 0.0, 360.0))
        require_letter(fields, "headingMag", "M", "format")
        return [self._heading(t_ns, magnetic_deg, HeadingReference.MAGNETIC)]

    def _read_hdt(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = parse(body)
        true_deg = number(fields, "headingT", 0.0, 360.0)
        require_letter(fields, "headingTu", "T", "format")
        return [self._heading(t_ns, true_deg, HeadingReference.TRUE)]

    def _read_ths(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = parse(body)
        # Other modes: estimated, manual, simulated, void. Such a heading is not measured.
        require_letter(fields, "mi", "A", "invalid_mode")
        return [self._heading(t_ns, number(fields, "headt", 0.0, 360.0), HeadingReference.TRUE)]

    def _read_vhw(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = parse(body)
        is_true, is_magnetic = fields.get("hdgT", "") != "", fields.get("hdgM", "") != ""
        if self._has_compass or not (is_true or is_magnetic):
            raise RejectedError("other_sentence")
        samples: list[Sample] = []
        if is_true:
            require_letter(fields, "hgdTu", "T", "format")
            true_deg = number(fields, "hdgT", 0.0, 360.0)
            samples.append(self._heading(t_ns, true_deg, HeadingReference.TRUE))
        if is_magnetic:
            require_letter(fields, "hgdMu", "M", "format")
            magnetic_deg = self._corrected(number(fields, "hdgM", 0.0, 360.0))
            samples.append(self._heading(t_ns, magnetic_deg, HeadingReference.MAGNETIC))
        return samples

    def _read_osd(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = parse(body)
        if self._has_compass:
            raise RejectedError("other_sentence")
        require_letter(fields, "hdgstate", "A", "invalid_mode")
        return [self._heading(t_ns, number(fields, "hdg", 0.0, 360.0), HeadingReference.TRUE)]

    def _read_rot(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = parse(body)
        require_letter(fields, "valid", "A", "invalid_mode")
        turn_deg_min = number(fields, "rot", -FASTEST_TURN_DEG_MIN, FASTEST_TURN_DEG_MIN)
        rate_rad_s = -math.radians(turn_deg_min) / 60.0
        return [RateSample(device=self._name, t_ns=t_ns, rate_z_rad_s=rate_rad_s)]

    def _read_xdr(self, body: bytes, t_ns: int) -> list[Sample]:
        fields = parse(body)
        roll_deg = pitch_deg = None
        for key, transducer in fields.items():
            if not key.startswith("tdrid_"):
                continue
            index = key.removeprefix("tdrid_")
            is_angle = fields.get(f"tdrtype_{index}") == "A" and fields.get(f"dataunit_{index}") == "D"
            if is_angle and str(transducer).upper() in ROLL_NAMES:
                roll_deg = number(fields, f"data_{index}", -180.0, 180.0)
            elif is_angle and str(transducer).upper() in PITCH_NAMES:
                pitch_deg = number(fields, f"data_{index}", -90.0, 90.0)
        if roll_deg is None and pitch_deg is None:
            raise RejectedError("other_sentence")
        return [self._attitude(t_ns, roll_deg, pitch_deg)]

    def _read_pashr(self, body: bytes, t_ns: int) -> list[Sample]:
        # Read by hand: pynmeagps (1.1.8) raises IndexError on an empty time, which PASHR has before the first
        # fix, and rejects the sentence for a leap second; the time is not used here.
        texts = body.decode("ascii").split(",")
        if texts[1:2] and texts[1].isalpha():
            raise RejectedError("other_sentence")  # $PASHR,ATT,... and similar are other messages
        if len(texts) < 6:
            raise RejectedError("format")
        names = ("heading", "indicator", "roll", "pitch")
        fields: dict[str, object] = dict(zip(names, texts[2:6], strict=True))
        roll_deg = number(fields, "roll", -180.0, 180.0)
        pitch_deg = number(fields, "pitch", -90.0, 90.0)
        samples: list[Sample] = [self._attitude(t_ns, roll_deg, pitch_deg)]
        if fields["heading"] != "":
            true_deg = number(fields, "heading", 0.0, 360.0)
            require_letter(fields, "indicator", "T", "format")
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


def _east_positive(fields: dict[str, object], key: str) -> float | None:
    """Return a deviation or variation in deg, or None where the field is empty."""
    if fields.get(key, "") == "":
        return None
    value_deg = number(fields, key, 0.0, 180.0)
    side = fields.get(f"{key}EW")
    if side not in ("E", "W"):
        raise RejectedError("format")
    return value_deg if side == "E" else -value_deg
