"""Ranking of missing terms, three ways: `python -m benchmarks.gap_machines.force_regression`.

The workflow ranks free terms by the output error, to first order. Here the same terms are also ranked by a
regression of posterior draws of the random force, with stability selection: in each draw half of the runs are
taken, and the two terms that explain most of the force are selected. In cases with a single term outside the
catalogue it prints at which place the first term in exactly the hidden variables is.
"""

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks.gap_machines.models import MODELS
from benchmarks.gap_machines.models.parts import to_runs
from benchmarks.gap_machines.truth import mentioned, variables
from rover_hil.gap.data.problem import split_point
from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.evidence.score import one_sided_z
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.noise.random_force import prior_covariance
from rover_hil.gap.search.free_terms import FreeTerm, free_terms, strength_of
from rover_hil.gap.search.search import best_shapes, score_effects
from rover_hil.gap.search.tracking import Tracked
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Array
from sim_backends.state_model.model import StateModel
from tests.nature.machines import make_case
from tests.nature.machines.make import kind_of

DRAWS = 60
SELECTED = 2
LEAST_REFIT = 3.0
LEAST_SIZE = 1e-4
NOWHERE = 999
WAYS = ("output error, first order", "draws of the force", "draws, smoothed terms, whitened")


@dataclass(frozen=True, kw_only=True)
class RunForce:
    """The random force of one run at its knots, and what it is regressed on.

    Attributes:
        mean: Of the posterior, in natural sizes; all ports in one vector.
        root: Of its covariance.
        terms: Terms x knots of all ports.
        absorbed: The same of base parameters and unknowns of the run.
    """

    mean: Array
    root: Array
    terms: Array
    absorbed: Array


def orders(findings: MachineFindings, *, is_wide: bool) -> list[list[str]]:
    """Return the equations of the free terms in the order of each of `WAYS`."""
    machine, tracked = findings.machine, findings.tracked
    if not isinstance(machine, StateModel) or tracked is None:
        return []
    terms = free_terms(machine, findings.problem, findings.best, is_wide=is_wide)
    names = [strength_of(machine, one)[0] for one in terms]
    found = [_by_output_error(findings, machine, terms, names)]
    raw = _forces(findings, machine, tracked, terms)
    counts = [_frequencies(runs) for runs in (raw, [_whitened(one, tracked) for one in raw])]
    found += [[names[index] for index in np.argsort(-one, kind="stable")] for one in counts]
    return found


def _by_output_error(
    findings: MachineFindings, machine: StateModel, terms: Sequence[FreeTerm], names: Sequence[str]
) -> list[str]:
    wider = machine.with_effects([*machine.port_effects, *(one.effect for one in terms)])
    problem = type(findings.problem)(wider, findings.problem.observations)
    scores = best_shapes(score_effects(MachineFits(problem, wider.effects), findings.best))
    ranked = sorted(scores, key=one_sided_z, reverse=True)
    return [one.direction.name for one in ranked if one.direction.name in names]


def _forces(
    findings: MachineFindings, machine: StateModel, tracked: Tracked, terms: Sequence[FreeTerm]
) -> list[RunForce]:
    basis, point, free = tracked.noise.basis, tracked.point, tracked.free
    moving = tracked.problem.model
    if not isinstance(moving, StateModel):
        raise AssertionError("a forced machine is a machine")
    columns = tracked.problem.derivatives(point, free) * np.array([item.sd for item in free])
    absorbed = [tracked.noise.smoothed_forces(np.nan_to_num(column)) for column in columns.T]
    places = np.arange(basis.knots) * basis.spacing
    port = [basis.ports.index(one.effect.port) for one in terms]
    found = []
    for run, series in enumerate(moving.trajectories(findings.problem.sites, *split_point(point))):
        at = {name: np.interp(places, np.arange(one.size), one) for name, one in series.items()}
        table = np.zeros((len(terms), len(basis.ports), basis.knots))
        for index, one in enumerate(terms):
            if one.effect.change is None:
                raise AssertionError("a free term changes its signal")
            signals, unit = SimpleNamespace(**at), SimpleNamespace(coefficient=1.0)
            table[index, port[index]] = one.effect.change(np.zeros(basis.knots), signals, unit, None)
        values, vectors = np.linalg.eigh(tracked.covariances[run])
        least = 1e-9 * max(float(values.max()), 1e-12)
        found.append(
            RunForce(
                mean=tracked.forces[run],
                root=np.asarray(vectors * np.sqrt(np.maximum(values, least))),
                terms=table.reshape(len(terms), -1),
                absorbed=np.array([one[run][0] for one in absorbed]),
            )
        )
    return found


def _whitened(run: RunForce, tracked: Tracked) -> RunForce:
    """Return terms as the smoother would see them, and everything in units of the posterior."""
    sizes = [(max(size, LEAST_SIZE), length) for size, length in tracked.noise.sizes]
    prior = prior_covariance(tracked.noise.basis, sizes) + 1e-10 * np.eye(run.mean.size)
    seen = run.terms - run.terms @ np.linalg.solve(prior, run.root @ run.root.T)
    return RunForce(
        mean=np.asarray(np.linalg.solve(run.root, run.mean)),
        root=np.eye(run.mean.size),
        terms=np.asarray(np.linalg.solve(run.root, seen.T).T),
        absorbed=np.asarray(np.linalg.solve(run.root, run.absorbed.T).T),
    )


def _frequencies(runs: Sequence[RunForce]) -> Array:
    """Return how often each term is selected."""
    rng = np.random.default_rng(0)
    counts = np.zeros(runs[0].terms.shape[0])
    for _ in range(DRAWS):
        half = [runs[index] for index in rng.permutation(len(runs))[: max((len(runs) + 1) // 2, 2)]]
        force = np.concatenate([one.mean + one.root @ rng.standard_normal(one.mean.size) for one in half])
        terms = np.hstack([one.terms for one in half])
        known = np.hstack([one.absorbed for one in half])
        for _ in range(SELECTED):
            chosen = int(np.argmax(_gains(force, terms, known)))
            counts[chosen] += 1.0
            known = np.vstack((known, terms[chosen]))
    return counts / DRAWS


def _gains(force: Array, terms: Array, known: Array) -> Array:
    """Return the squared force that each term explains besides what is known."""
    size = np.linalg.norm(known, axis=1)
    used = known[size > 1e-9 * float(size.max())]
    left, singular, _ = np.linalg.svd((used.T / np.linalg.norm(used, axis=1)), full_matrices=False)
    basis = left[:, singular > 1e-6 * singular[0]]
    force = force - basis @ (basis.T @ force)
    before = np.linalg.norm(terms, axis=1)
    terms = terms - (terms @ basis) @ basis.T
    after = np.linalg.norm(terms, axis=1)
    gains = np.zeros(before.size)
    is_new = after > 1e-3 * before
    gains[is_new] = (terms[is_new] @ force / after[is_new]) ** 2
    return gains


def main(arguments: Sequence[str] | None = None) -> int:
    """Rank the terms of cases and print the places; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap_machines.force_regression")
    parser.add_argument("--first", type=int, default=0, help="number of the first case of each family")
    parser.add_argument("--cases", type=int, default=10, help="numbers of each family to look at")
    options = parser.parse_args(arguments)
    places: list[list[int]] = []
    for number in range(options.first, options.first + options.cases):
        for family, make_model in MODELS.items():
            if kind_of(family, number) != "outside":
                continue
            case = make_case(family, number)
            if case.snr_after_refit < LEAST_REFIT:
                continue
            found = analyse(make_model(), to_runs(case)).machine
            if found is None or not found.drafts:
                continue
            hidden = variables(case.terms[0].variables)
            ranked = orders(found, is_wide=False)
            places.append([place_of(hidden, family, order) for order in ranked])
            print(family, number, case.terms[0].name, *places[-1], flush=True)
    print_table(places)
    return 0


def place_of(hidden: set[str], family: str, order: Sequence[str]) -> int:
    """Return the place of the first term in exactly the hidden variables, from 0."""
    return next((place for place, name in enumerate(order) if mentioned(family, name) == hidden), NOWHERE)


def print_table(places: Sequence[Sequence[int]]) -> None:
    """Print how often each way has the right variables first, and among the first five."""
    for way, column in zip(WAYS, zip(*places, strict=True), strict=False):
        first, five = (sum(place < limit for place in column) for limit in (1, 5))
        print(f"{way:34}first {first:3}, among five {five:3}, of {len(column)}")


if __name__ == "__main__":
    raise SystemExit(main())
