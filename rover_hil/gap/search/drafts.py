"""Drafts of a missing law: free-form terms of the equations that explain what is left.

A draft passes the rules of effects. The test runs confirm it as they confirm a name; such drafts come first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Problem
from rover_hil.gap.evidence.evidence import MachineFit, Names
from rover_hil.gap.evidence.sizes import size_of
from rover_hil.gap.fit.holdout import Holdout, hold_out, is_confirming
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.free_terms import FittedTerm, free_terms, search_terms, strength_of
from sim_backends.models.interface import Run
from sim_backends.models.parameter_key import ParameterKey
from sim_backends.state_model.model import StateModel


@dataclass(frozen=True, slots=True, kw_only=True)
class DraftTerm:
    """A term that is missing in the equations.

    Attributes:
        equation: As text, its coefficient called c.
        port: Where it is added.
        coefficient: Fitted.
        low: Lower end of the 95 % interval.
        high: Upper end.
        unit: Of the coefficient.
        code: Line that adds it to a model as an effect.
        closest: The most similar effect of the model, named or not; empty where there is none.
        cosine: Their similarity, 0..1, in what they change and the base parameters do not.
        closure: Share of the gap on the test runs that it closes; None where there is none.
        improved: Share of the test runs that it improves.
    """

    equation: str
    port: str
    coefficient: float
    low: float
    high: float
    unit: str
    code: str
    closest: str
    cosine: float
    closure: float | None
    improved: float

    def is_law_of(self, names: Names) -> bool:
        """Return True where it is the same law as one of some effects."""
        return self.closest in names and self.cosine > MACHINES.terms.same_law

    @property
    def is_confirmed(self) -> bool:
        """True where it closes most of the gap on the test runs and improves most of them, as a name does."""
        return is_confirming(self.closure, self.improved)


def missing_terms(machine: StateModel, problem: Problem, at: MachineFit) -> list[FittedTerm]:
    """Return the terms that explain most of what a fit leaves and pass the rules of effects, best first."""
    terms = free_terms(machine, problem, at, is_wide=True)
    return [one for one in search_terms(machine, problem, terms, at) if not one.objection]


def confirmed_drafts(
    machine: StateModel,
    locked: Sequence[Run],
    at: MachineFit,
    terms: Sequence[FittedTerm],
    rng: np.random.Generator,
) -> tuple[DraftTerm, ...]:
    """Return missing terms as drafts with what the test runs say of them, the confirmed ones first."""
    found = []
    for one in terms:
        wider = machine.with_effects([*machine.port_effects, one.term.effect])
        found.append(_draft(machine, one, hold_out(wider, locked, at, one.fit, rng)))
    found.sort(key=lambda one: not one.is_confirmed)
    return tuple(found[: MACHINES.terms.most_drafts])


def _draft(machine: StateModel, found: FittedTerm, holdout: Holdout) -> DraftTerm:
    name, coefficient = strength_of(machine, found.term)
    size = size_of(found.fit, ParameterKey(effect=name, name=coefficient.name))
    return DraftTerm(
        equation=name,
        port=found.term.effect.port,
        coefficient=size.value,
        low=size.low,
        high=size.high,
        unit=coefficient.unit,
        code=found.term.code,
        closest=found.closest,
        cosine=found.cosine,
        closure=holdout.closure,
        improved=holdout.improved,
    )
