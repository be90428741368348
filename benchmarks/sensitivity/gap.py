"""Numbers of `rover-hil gap`: sums over a few development cases.

Verdicts with a name, members of the sets of alternatives, sets that hold the truth; the logarithm of the
probability of the gap; error on locked runs after over that before; widths of the intervals over the sizes;
and, of machines, the probability of a right verdict after the proposed run.

Cases: `side` is a case of `benchmarks/gap/cases.py` (from 10000 on), `drive` the place of a case in
`benchmarks/gap/battery_drives.py`, `cart` a small cart of `benchmarks/gap_machines/small_carts.py`; the name
of a family is a machine of `tests/nature/machines` (below 1000).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from benchmarks.gap import battery_drives
from benchmarks.gap.cases import cases, make_runs
from benchmarks.gap_machines.models import MODELS
from benchmarks.gap_machines.models.parts import to_runs
from benchmarks.gap_machines.small_carts import make_cart
from benchmarks.gap_machines.small_carts import make_model as make_cart_model
from benchmarks.sensitivity.subject import Score, Subject
from drivers.errors import ConfigError
from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.noise.parameters import STATISTICS
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.models.side_slope.model import make_model
from tests.nature.machines import make_case

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

Case = tuple[Callable[[], Verdict], frozenset[str]]


def case_of(name: str) -> Case:
    """Return how to get the verdict of a case, and the names of what is hidden."""
    kind, number = name.split(":")
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


def prepare(cases: Sequence[str]) -> Score:
    """Return what computes the sums over these cases."""
    return partial(figures, [case_of(case) for case in cases])


def figures(cases: Sequence[Case]) -> Mapping[str, float]:
    """Return the sums over the cases."""
    results = [(verdict(), hidden) for verdict, hidden in cases]
    verdicts = [verdict for verdict, _ in results]
    sizes = [
        size for verdict in verdicts for effect in verdict.effects for size in effect.parameters.values()
    ]
    channels = [channel for verdict in verdicts for channel in verdict.gap.values()]
    proposed = [option for verdict in verdicts for option in verdict.next_runs[:1]]
    return {
        "named": float(sum(verdict.verdict in NAMED for verdict in verdicts)),
        "members": float(sum(len(verdict.confidence_set) for verdict in verdicts)),
        "with the truth": float(
            sum(any(hidden <= set(names) for names in verdict.confidence_set) for verdict, hidden in results)
        ),
        "log10 p": sum(
            math.log10(max(verdict.p_gap, 1e-300)) for verdict in verdicts if verdict.p_gap is not None
        ),
        "error after / before": sum(_ratio(channel) for channel in channels),
        "width / size": sum((size.ci95[1] - size.ci95[0]) / abs(size.value) for size in sizes if size.value),
        "next run": sum(_probability(option) for option in proposed),
    }


def _probability(option: Mapping[str, object]) -> float:
    probability = option["probability_right"]
    return probability if isinstance(probability, float) else math.nan


def _ratio(channel: Mapping[str, object]) -> float:
    before, after = channel.get("before"), channel.get("after")
    return after / before if isinstance(before, float) and isinstance(after, float) and before else 0.0


USUAL = "side:10008,drive:13,cart:0"
SUBJECTS = {
    name: Subject(
        parameters=parameters, cases=cases, prepare=prepare, near_one=NEAR_ONE, refusals=(ConfigError,)
    )
    for name, parameters, cases in (
        ("data", DATA, USUAL),
        ("statistics", STATISTICS, USUAL),
        ("machines", MACHINES, f"{USUAL},cart:1,thermal:1"),
    )
}
