"""Sentences of NMEA 0183: lines, checksums and fields, for every device that sends them."""

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import reduce
from operator import xor

from pynmeagps import VALNONE, NMEAReader
from pynmeagps.exceptions import NMEAParseError, NMEATypeError

from drivers.driver import Rejection
from drivers.link import Received
from drivers.samples import Sample

LONGEST_SENTENCE = 255
"""Bytes kept of a line. The standard allows 82; real devices exceed it."""
LINE_END = re.compile(rb"[\r\n]+")
OTHER_TEXT = re.compile(rb"[#!%][A-Z][0-9A-Z]+,[ -~]*")
"""Logs of Unicore and NovAtel receivers and sentences of AIS, which may stand among those of NMEA 0183."""
BODY_AND_CHECKSUM = re.compile(rb"([ -)+-~]+)(?:\*([0-9A-Fa-f]{2}))?")


class RejectedError(Exception):
    """A sentence holds something that must not become a sample; the argument is the rejection's reason."""


def encode_sentence(body: str) -> bytes:
    """Return a sentence with start, checksum and line end, e.g. for the body "HCHDM,238.4,M"."""
    return f"${body}*{reduce(xor, body.encode('ascii'), 0):02X}\r\n".encode("ascii")


class SentenceCodec(ABC):
    """Divides bytes into sentences. Rejections: "framing", "checksum", and those of `read_sentence`.

    Args:
        require_checksum: Reject sentences without a checksum.
    """

    def __init__(self, *, require_checksum: bool) -> None:
        self._require_checksum = require_checksum
        self._tail = b""

    @abstractmethod
    def read_sentence(self, name: str, body: bytes, t_ns: int) -> Sequence[Sample]:
        """Return the samples of a sentence.

        Args:
            name: Its address without the talker; of a proprietary one the whole address.
            body: Without start and checksum.
            t_ns: Time of arrival.

        Raises:
            RejectedError: It holds something that must not become a sample.
        """

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
        """Forget a half-received line."""
        self._tail = b""

    def _read_line(self, line: bytes, t_ns: int) -> Sequence[Sample | Rejection]:
        try:
            body = self._checked_body(line)
            address = body.partition(b",")[0].decode("ascii")
            # Proprietary addresses start with P, all others with a talker of two letters.
            return self.read_sentence(address if address.startswith("P") else address[2:], body, t_ns)
        except RejectedError as rejected:
            return (Rejection(str(rejected)),)

    def _checked_body(self, line: bytes) -> bytes:
        _, start, sentence = line.rpartition(b"$")
        if OTHER_TEXT.fullmatch(line):
            raise RejectedError("other_sentence")
        match = BODY_AND_CHECKSUM.fullmatch(sentence)
        if not start or match is None:
            raise RejectedError("framing")
        body, checksum = match.groups()
        if checksum is None:
            if self._require_checksum:
                raise RejectedError("checksum")
        elif int(checksum, 16) != reduce(xor, body):
            raise RejectedError("checksum")
        return body


def parse(body: bytes) -> dict[str, object]:
    """Return the fields of a standard sentence by the names that pynmeagps gives them."""
    try:
        message = NMEAReader.parse(body + b"*", validate=VALNONE)  # the checksum has been verified
    except (NMEAParseError, NMEATypeError) as error:
        raise RejectedError("format") from error
    return {} if message is None else vars(message)


def number(fields: dict[str, object], key: str, low: float, high: float) -> float:
    """Return a field.

    Raises:
        RejectedError: It is empty, no number, or outside its range.
    """
    text = fields.get(key, "")
    if text == "":
        raise RejectedError("empty")
    if not isinstance(text, str | int | float):
        raise RejectedError("format")
    try:
        value = float(text)
    except ValueError as error:
        raise RejectedError("format") from error
    if not low <= value <= high:  # rejects NaN too
        raise RejectedError("range")
    return value


def require_letter(fields: dict[str, object], key: str, letter: str, reason: str) -> None:
    """Reject a sentence without a certain letter in a field."""
    if fields.get(key) != letter:
        raise RejectedError(reason)


def _shortened(line: bytes) -> bytes:
    """Return the end of a line, where a sentence may be; the begin of other text, which shows its kind."""
    return line[:LONGEST_SENTENCE] if line[:1] in (b"#", b"!", b"%") else line[-LONGEST_SENTENCE:]
