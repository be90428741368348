"""The page of verdicts lists every verdict and every key of the files."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from rover_hil.gap.next_run.allowed import Allowed, InputRange
from rover_hil.gap.verdict import Answer, FittedBase, Verdict

PAGE = (Path(__file__).parents[3] / "docs/reference/gap_verdict.md").read_text("utf-8")
KEYS = {field.name for kind in (Verdict, FittedBase) for field in fields(kind)} - {"verdict", "name"}
KEYS_OF_A_FILE = {*Allowed.model_fields, *InputRange.model_fields}


@pytest.mark.parametrize("name", sorted({*Answer, *KEYS}))
def test_the_page_has_the_verdict_or_the_key(name: str) -> None:
    assert re.search(rf"`{name}`", PAGE)


@pytest.mark.parametrize("name", sorted(KEYS_OF_A_FILE))
def test_the_page_has_the_key_of_allowed_runs(name: str) -> None:
    assert re.search(rf"^(?:{name} = |\[{name}\.)", PAGE, re.MULTILINE)
