"""The file of draft effects: terms that are missing, as lines of code that a model can use."""

import re
from collections.abc import Mapping
from typing import Any

from rover_hil.gap.verdict import Verdict

DRAFT_NAME = "draft_effects.py"


def draft_lines(verdict: Verdict) -> list[str]:
    """Return the line of code of each draft, with a name that a model file and a page can show."""
    lines: list[str] = []
    names: list[str] = []
    for one in verdict.draft:
        name = re.sub("[^A-Za-z0-9]+", "_", str(one["term"]).replace(" += c ", " ")).strip("_")
        if name in names:
            name = f"{name}_{len(names) + 1}"
        names.append(name)
        lines.append(f'{str(one["code"]).removesuffix(")")}, name="{name}")')
    return lines


def draft_text(verdict: Verdict) -> str:
    """Return the text of the file."""
    parts = [
        '"""Draft effects of a gap analysis: terms that would explain what no effect of the model explains.',
        "",
        "Add the terms that have a physical reason to the `port_effects` of the model, analyse again. They",
        "were found on the same runs: new runs must confirm them.",
        '"""',
        "",
        "from rover_hil.gap import effects",
        "",
        "DRAFT = (",
    ]
    for one, line in zip(verdict.draft, draft_lines(verdict), strict=True):
        parts += [f"    # {_comment(one)}", f"    {line},"]
    return "\n".join([*parts, ")"]) + "\n"


def _comment(draft: Mapping[str, Any]) -> str:
    unit = "" if draft["unit"] == "1" else f" {draft['unit']}"
    size = f"c = {draft['coefficient']:.3g}{unit}, 95 % interval {draft['low']:.3g} to {draft['high']:.3g}"
    return f"{draft['term']}; {size}; {tested_words(draft)}"


def tested_words(draft: Mapping[str, Any]) -> str:
    """Return what the test runs say of a draft."""
    if draft["closure"] is None:
        return "the test runs have no gap to confirm it"
    sure = "confirmed by them" if draft["is_confirmed"] else "not confirmed by them"
    return (
        f"closes {draft['closure']:.0%} of the gap on the test runs and improves {draft['improved']:.0%} of "
        f"them: {sure}"
    )
