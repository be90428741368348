"""Drafts of a missing law: free-form terms of the equations that explain what is left.

A draft passes the rules of effects. The locked runs confirm it where the variance of the random force that
the machine needs to follow them falls by the share that the rules require; such drafts come first.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Point, Problem, observe
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.sizes import size_of
from rover_hil.gap.fit.descent import residual_of
from rover_hil.gap.fit.holdout import with_own_unknowns
from rover_hil.gap.noise.random_force import random_force_noise
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.free_terms import FittedTerm, free_terms, search_terms, strength_of
from rover_hil.gap.search.tracking import basis_of
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
        closest: The most similar effect of the model; empty where it has none.
        cosine: Their similarity, 0..1, in what they change and the base parameters do not.
        force_before: Root mean square of the random force at the port in the locked runs without it, in the
            unit of the port.
        force_after: The same with it.
        force_unit: Unit of the port.
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
    force_before: float
    force_after: float
    force_unit: str

    @property
    def is_confirmed(self) -> bool:
        """True where the locked runs need a clearly smaller force with it."""
        return self.force_after**2 < (1.0 - MACHINES.search.share) * self.force_before**2


def find_drafts(
    machine: StateModel, problem: Problem, locked: Sequence[Run], at: MachineFit
) -> list[tuple[DraftTerm, FittedTerm]]:
    """Return the terms that explain most of what is left, the best first and unconfirmed ones last."""
    terms = free_terms(machine, problem, at, is_wide=True)
    fitted = [one for one in search_terms(machine, problem, terms, at) if not one.objection]
    if not fitted:
        return []
    before = _force_rms(machine, locked, at.fit.point)
    found: list[tuple[DraftTerm, FittedTerm]] = []
    for one in fitted:
        effect = one.term.effect
        after = _force_rms(machine.with_effects([*machine.port_effects, effect]), locked, one.fit.fit.point)
        found.append((_draft(machine, one, before[effect.port], after[effect.port]), one))
    found.sort(key=lambda pair: not pair[0].is_confirmed)
    return found[: MACHINES.terms.most_drafts]


def _force_rms(machine: StateModel, locked: Sequence[Run], point: Point) -> dict[str, float]:
    """Return the size of the random force that keeps the machine on the locked runs, by port."""
    problem = Problem(machine, observe(machine, locked))
    own = with_own_unknowns(problem, point)
    residual = residual_of(problem.observations, problem.predict(own))
    basis = basis_of(problem, machine, own)
    noise = random_force_noise(problem.observations, residual, basis)
    smoothed = noise.smoothed_forces(np.nan_to_num(residual))
    squares = np.array([mean**2 + np.diag(covariance) for mean, covariance in smoothed])
    by_port = squares.reshape(len(smoothed), len(basis.ports), basis.knots).mean(axis=(0, 2))
    return {
        port: scale * math.sqrt(max(float(square), 0.0))
        for port, scale, square in zip(basis.ports, basis.scales, by_port, strict=True)
    }


def _draft(machine: StateModel, found: FittedTerm, before: float, after: float) -> DraftTerm:
    name, coefficient = strength_of(machine, found.term)
    size = size_of(found.fit, ParameterKey(effect=name, name=coefficient.name))
    port = found.term.effect.port
    return DraftTerm(
        equation=name,
        port=port,
        coefficient=size.value,
        low=size.low,
        high=size.high,
        unit=coefficient.unit,
        code=found.term.code,
        closest=found.closest,
        cosine=found.cosine,
        force_before=before,
        force_after=after,
        force_unit=next(one.unit for one in machine.ports if one.name == port),
    )
