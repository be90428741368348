"""One case: what was hidden, and what the workflow answered, as a line of JSON."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from benchmarks.gap_machines.models import MODELS
from benchmarks.gap_machines.models.parts import to_runs
from benchmarks.gap_machines.truth import hidden_cards
from drivers.clock import SystemClock, seconds
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.verdict import Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.models.parameter_key import ParameterKey
from tests.nature.machines import make_case
from tests.nature.machines.case import Case

Record = dict[str, Any]
NORMAL_95 = 1.96


def judge_case(family: str, number: int, version: str) -> Record:
    """Return the record of a case; an error of the workflow is recorded, not raised."""
    case = make_case(family, number)
    record: Record = {
        "version": version,
        "family": family,
        "number": number,
        "kind": case.kind,
        "extra_scatter": case.extra_scatter,
        "snr": case.snr,
        "snr_after_refit": case.snr_after_refit,
        "snr_each": dict(case.snr_each),
        "hidden": {name: dict(values) for name, values in case.effects.items()},
        "cards": hidden_cards(case),
        "terms": [asdict(term) for term in case.terms],
        "error": "",
    }
    clock = SystemClock()
    start_ns = clock.now_ns()
    try:
        record |= _answer(analyse(MODELS[family](), to_runs(case)).verdict)
        record["oracle"] = _oracle(family, case) if case.kind == "single" else {}
    except Exception as error:  # noqa: BLE001 (a crash is a result of the benchmark)
        record["error"] = f"{type(error).__name__}: {error}"
    record["seconds"] = round(seconds(clock.now_ns() - start_ns), 2)
    finite: Record = plain(record)
    return finite


def _oracle(family: str, case: Case) -> dict[str, float]:
    """Return the width of the 95 % interval by somebody who knows the law: its fit to all runs of a case."""
    runs = to_runs(case)
    model = MODELS[family]().refined(runs)
    fits = MachineFits(Problem(model, observe(model, runs)), model.effects)
    cards = hidden_cards(case)
    found = fits.best(tuple(cards), {}, fits.base().fit.point)
    widths = {}
    for name, parameters in cards.items():
        key = ParameterKey(effect=name, name=next(iter(parameters)))
        index = found.left_out.keys.index(key)
        sd = next(item.sd for item in found.fit.free if item.key == key)
        widths[name] = 2.0 * NORMAL_95 * sd * float(found.left_out.by_samples[index])
    return widths


def _answer(verdict: Verdict) -> Record:
    return {
        "verdict": str(verdict.verdict),
        "sentence": verdict.sentence,
        "p_gap": verdict.p_gap,
        "effects": {
            effect.name: {
                name: {"value": found.value, "ci95": list(found.ci95)}
                for name, found in effect.parameters.items()
            }
            for effect in verdict.effects
        },
        "confidence_set": [sorted(names) for names in verdict.confidence_set],
        "gap": verdict.gap,
        "unnamed": verdict.unnamed,
        "draft": getattr(verdict, "draft", ()),
    }


def plain(value: Any) -> Any:
    """Return a value in the types of JSON; numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
