"""The rules by which the proposal decides, against those of the search."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from rover_hil.gap.evidence.evidence import Evidence
from rover_hil.gap.next_run.rules import _are_equal


def _fit(squares: object, counts: object) -> Any:
    left_out = SimpleNamespace(squares=squares, counts=counts)
    return cast("Any", SimpleNamespace(left_out=left_out, evidence=Evidence()))


def test_equal_explanations_are_those_of_the_search() -> None:
    rng = np.random.default_rng(3)
    counts = rng.integers(30, 300, 5).astype(float)
    one, other = (counts * rng.uniform(0.7, 1.1 + 0.6 * shift, (40, 5)) for shift in (0, 1))
    expected = [
        Evidence().is_equal(_fit(a, counts), _fit(b, counts)) for a, b in zip(one, other, strict=True)
    ]
    assert 5 < sum(expected) < 35
    assert _are_equal(one, other, counts).tolist() == expected
