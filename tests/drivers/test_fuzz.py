"""Parsers under random and mutated input, and the harness itself under parsers that misbehave."""

from collections.abc import Sequence

import numpy as np
import pytest

from benchmarks.program.fuzz_parsers import BLOCK, PARSERS, Report, fuzz, held_bytes
from drivers.driver import Rejection
from drivers.link import Received
from drivers.samples import RateSample, Sample

INPUTS = 20_000


@pytest.mark.parametrize("name", PARSERS)
def test_parser_survives(name: str) -> None:
    codec, seeds = PARSERS[name]()
    report = fuzz(codec, seeds, INPUTS, np.random.default_rng(7))
    assert report.failures == []
    assert report.inputs == INPUTS
    assert report.accepted > INPUTS // 1000
    assert sum(report.rejected.values()) > INPUTS // 20


class BadCodec:
    """Accepts everything but does one thing wrong."""

    def __init__(self, fault: str) -> None:
        self._fault = fault
        self.hoard = b""

    def decode(self, item: Received[bytes]) -> Sequence[Sample | Rejection]:
        if self._fault == "raises" and b"\x00" in item.payload:
            msg = "a zero byte"
            raise ValueError(msg)
        if self._fault == "hoards":
            self.hoard += item.payload[:4]
        if self._fault == "names":
            return (Rejection(item.payload.hex()),)
        rate_rad_s = float("nan") if self._fault == "not finite" else 0.0
        return (RateSample(device="bad", t_ns=item.t_ns, rate_z_rad_s=rate_rad_s),)

    def reset(self) -> None:
        """Nothing to forget."""


def report_on(fault: str) -> Report:
    BadCodec.__module__ = "drivers.bad"  # the harness looks into our own objects only
    return fuzz(BadCodec(fault), (b"abc", b"defghi"), BLOCK, np.random.default_rng(7))


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("raises", "a zero byte"),
        ("hoards", "holds"),
        ("names", "different reasons"),
        ("not finite", "rate_z_rad_s is not finite"),
    ],
)
def test_harness_notices(fault: str, words: str) -> None:
    assert any(words in failure for failure in report_on(fault).failures)


def test_harness_is_content_with_a_good_parser() -> None:
    report = report_on("none")
    assert report.failures == []
    assert report.accepted == BLOCK


def test_held_bytes_looks_into_parts() -> None:
    codec, _ = PARSERS["robotino_board"]()
    before = held_bytes(codec)
    codec.decode(Received(0, b"REC" + bytes(50)))
    assert held_bytes(codec) == before + 53
