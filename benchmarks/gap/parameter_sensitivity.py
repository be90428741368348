"""How much verdicts of `gap` change when each of its tuned numbers is varied by 20 %.

    python -m benchmarks.gap.parameter_sensitivity [--of data,statistics,machines]
        [--groups search,verdict] [--cases side:10008,drive:13,cart:0]

Varies each number of `parameters.py` in `rover_hil/gap/data`, `statistics` and `machines` to 0.8
and 1.2 of its value (whole numbers change by at least 1; of levels and cosines the rest to 1). Prints as
Markdown the changes of sums over a few development cases: verdicts with a name, members of the sets of
alternatives, sets that hold the truth; the logarithm of the probability of the gap; error on locked runs
after over that before; widths of the intervals over the sizes; and, of machines, the probability of a right
verdict after the proposed run. "refused": the data are rejected. Numbers that change no figure,
and numbers that no case reads, are listed below the table.

Cases: `side` is a case of `benchmarks/gap/cases.py` (from 10000 on), `drive` the place of a case in
`benchmarks/gap/battery_drives.py`, `cart` a small cart of `benchmarks/gap_machines/small_carts.py`; the name
of a family is a machine of `tests/nature/machines` (below 1000).
"""

import argparse
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from benchmarks.gap import battery_drives
from benchmarks.gap.cases import cases, make_runs
from benchmarks.gap_machines.models import MODELS
from benchmarks.gap_machines.models.parts import to_runs
from benchmarks.gap_machines.small_carts import make_cart
from benchmarks.gap_machines.small_carts import make_model as make_cart_model
from benchmarks.sensitivity import print_table
from drivers.errors import ConfigError
from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.machines.parameters import MACHINES
from rover_hil.gap.statistics.parameters import STATISTICS
from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.models.side_slope.model import make_model
from tests.nature.machines import make_case

OBJECTS: dict[str, tuple[object, str]] = {
    "data": (DATA, "side:10008,drive:13,cart:0"),
    "statistics": (STATISTICS, "side:10008,drive:13,cart:0"),
    "machines": (MACHINES, "side:10008,drive:13,cart:0,cart:1,thermal:1"),
}
"""The object, and the cases that it is varied on."""
NEAR_ONE = (
    "beyond_chance",
    "almost_all",
    "set_level",
    "alike",
    "twins",
    "same",
    "same_law",
    "similar",
    "level",
)
DRIVES = 40
"""Of the battery, from which a case is taken by its place."""
NAMED = (Answer.NAMED, Answer.NAMED_SET, Answer.PARTLY_NAMED)

Asked = tuple[Callable[[], Verdict], frozenset[str]]


def asked(case: str) -> Asked:
    """Return how to get the verdict of a case, and the names of what is hidden."""
    kind, number = case.split(":")
    if kind == "side":
        chosen = cases(int(number), 1)[0]
        runs = make_runs(chosen)[1]
        model = make_model()
        return lambda: analyse(model, runs, seed=chosen.seed).verdict, frozenset(chosen.names)
    if kind == "drive":
        drive = battery_drives.cases(DRIVES)[int(number)]
        return lambda: battery_drives.run(*drive).verdict, frozenset(drive[0].names)
    if kind == "cart":
        cart = make_cart(int(number))
        return (
            lambda: analyse(make_cart_model(), cart.runs, allowed=cart.allowed).verdict,
            frozenset() if cart.is_outside else frozenset((cart.law,)),
        )
    machine = make_case(kind, int(number))
    return lambda: analyse(MODELS[kind](), to_runs(machine)).verdict, frozenset(machine.effects)


def figures(some: Sequence[Asked]) -> Mapping[str, float]:
    """Return the sums over the cases."""
    found = [(verdict(), hidden) for verdict, hidden in some]
    verdicts = [verdict for verdict, _ in found]
    sizes = [one for verdict in verdicts for effect in verdict.effects for one in effect.parameters.values()]
    errors = [channel for verdict in verdicts for channel in verdict.gap.values()]
    return {
        "named": float(sum(verdict.verdict in NAMED for verdict in verdicts)),
        "members": float(sum(len(verdict.confidence_set) for verdict in verdicts)),
        "with the truth": float(
            sum(any(hidden <= set(one) for one in verdict.confidence_set) for verdict, hidden in found)
        ),
        "log10 p": sum(
            math.log10(max(verdict.p_gap, 1e-300)) for verdict in verdicts if verdict.p_gap is not None
        ),
        "error after / before": sum(_ratio(one) for one in errors),
        "width / size": sum((one.ci95[1] - one.ci95[0]) / abs(one.value) for one in sizes if one.value),
        "next run": sum(
            float(str(option["probability_right"]))
            for verdict in verdicts
            for option in verdict.next_runs[:1]
        ),
    }


def _ratio(channel: Mapping[str, object]) -> float:
    before, after = channel.get("before"), channel.get("after")
    return after / before if isinstance(before, float) and isinstance(after, float) and before else 0.0


def main() -> int:
    """Print one table for each object of numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--of", default=",".join(OBJECTS))
    parser.add_argument("--groups", help="with commas; all of them when left out")
    parser.add_argument("--cases", help="with commas; those of the object when left out")
    given = parser.parse_args()
    for name in given.of.split(","):
        parameters, usual = OBJECTS[name]
        chosen = given.cases or usual
        print(f"\n{name}: {chosen}", flush=True)
        print_table(
            parameters,
            partial(figures, [asked(case) for case in chosen.split(",")]),
            groups=given.groups,
            near_one=NEAR_ONE,
            refusals=(ConfigError,),
            effects_only=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
