"""Verdicts on all measured sets against what was expected of them, in measured_expectations.toml.

`python -m benchmarks.gap.measured_expectations DATA [--only NAME]`; exit code 1 where a verdict differs.
"""

import argparse
import math
import sys
import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.gap.measured_sets import measured_sets
from rover_hil.gap.fit.base_parameters import FAR_SD

NAMING = ("NAMED", "NAMED_SET", "PARTLY_NAMED")
SAME = {
    "push_number": "pushed_soil",
    "rim_friction_deg": "friction_angle",
    "radius_error": "wheel_radius",
    "scale_error": "camera_scale",
    "base_error": "base_radius",
    "pose_age_s": "latency",
}
"""Base parameters, and the effect that sets each free: one finding under two names."""


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """What is expected of a set; the file states what the fields mean."""

    reason: str
    verdicts: Sequence[str]
    must: Sequence[str] = ()
    names: Sequence[str] = ()
    sizes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    draft: str = ""
    says: str = ""


def read_expectations() -> dict[str, Expectation]:
    """Return what is expected of each set, by its name."""
    table = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
    return {name: Expectation(**one) for name, one in table.items()}


def explanations_of(verdict: Mapping[str, Any]) -> list[list[str]]:
    """Return what each explanation names: its effects, and the base parameters proven wrong."""
    wrong = [one["name"] for one in verdict["base_parameters"] if one["is_named"]]
    members = verdict["confidence_set"] if verdict["verdict"] in NAMING else []
    return [
        list(dict.fromkeys(SAME.get(name, name) for name in (*member, *wrong))) for member in members or [[]]
    ]


def differences(expected: Expectation, verdict: Mapping[str, Any]) -> list[str]:
    """Return where a verdict (verdict.json) is not what was expected; empty where it is."""
    found = [] if verdict["verdict"] in expected.verdicts else [f"not {' or '.join(expected.verdicts)}"]
    for names in explanations_of(verdict):
        found += [f"{name} is named" for name in names if name not in expected.names]
        found += [f"{name} is not named" for name in expected.must if name not in names]
    for effect in verdict["effects"]:
        for name, number in effect["parameters"].items():
            least, most = expected.sizes.get(name, number["ci95"])
            if number["ci95"][0] > most or number["ci95"][1] < least:
                found.append(f"{name} of {effect['name']} is outside {least} to {most}")
    drafts = [one["term"] for one in verdict["draft"]]
    if expected.draft and drafts[:1] != [expected.draft]:
        found.append(f"the first draft is {drafts[0] if drafts else 'missing'}, not {expected.draft}")
    if expected.says not in verdict["sentence"]:
        found.append(f"the sentence does not say {expected.says}")
    if _is_below_tolerance(verdict):
        found.append("a name below the tolerance")
    return list(dict.fromkeys(found))


def _is_below_tolerance(verdict: Mapping[str, Any]) -> bool:
    """Return whether effects are named although the model without them errs less than its tolerance.

    A base parameter far from nominal has taken the gap on itself; a noise that was learned contains the gap,
    which the test runs show.
    """
    if not verdict["effects"] or any(abs(one["pull"]) > FAR_SD for one in verdict["base_parameters"]):
        return False
    for name, budget in verdict["error_budget"].items():
        test = verdict["gap"].get(name, {"before": 0.0, "noise_floor": 0.0})
        error = math.sqrt(max(test["before"] ** 2 - test["noise_floor"] ** 2, 0.0))
        if max(budget["model_error_before"], error) > budget["tolerance"]:
            return False
    return True


def main() -> int:
    """Print each verdict and where it is not what was expected; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", default="", help="sets whose name contains this")
    arguments = parser.parse_args()
    expectations, is_right = read_expectations(), True
    for name, ask in measured_sets(arguments.data).items():
        if arguments.only not in name:
            continue
        begin_s = time.process_time()
        verdict = ask()
        took_s, wrong = time.process_time() - begin_s, differences(expectations[name], verdict)
        is_right &= not wrong
        members = " | ".join(" + ".join(one) for one in explanations_of(verdict))
        print(f"{name}: {verdict['verdict']} {members} ({took_s:.0f} s): {'; '.join(wrong) or 'as expected'}")
        print(f"    {verdict['sentence']}", flush=True)
    return 0 if is_right else 1


if __name__ == "__main__":
    sys.exit(main())
