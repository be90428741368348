"""Free-form terms at the ports of a machine: candidates for a law that no effect describes."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_hil.drives.arrays import rms
from rover_hil.gap.data.problem import Problem, split_point
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.score import Score, cosine, score_all
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.search import MachineSearch, ranked_scores, score_effects
from sim_backends.models.interface import Array, Parameter
from sim_backends.state_model.effects.terms import FORMS, MINUS, product, term, threshold
from sim_backends.state_model.model import StateModel
from sim_backends.state_model.port_effect import PortEffect

STILL = 1e-9
"""Range of a signal, over its size, below which it does not move."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeTerm:
    """A candidate, and the line of code that makes it."""

    effect: PortEffect
    code: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedTerm:
    """A candidate that was fitted.

    Attributes:
        term: The candidate.
        fit: The machine with it.
        objection: Why it is not accepted; empty where it is.
        closest: The most similar effect of the model, which the fit may have; empty where there is none.
        cosine: Their similarity, 0..1, in what they change and the base parameters do not.
    """

    term: FreeTerm
    fit: MachineFit
    objection: str
    closest: str
    cosine: float


def free_terms(
    machine: StateModel, problem: Problem, at: MachineFit, *, is_wide: bool = False
) -> list[FreeTerm]:
    """Return the candidates: every form of every state and input at every port, and products of two.

    With `is_wide` also differences of two in the same unit, and products with a square or a cube.
    """
    sources = usual_sources(machine, problem, at)
    products: list[tuple[str, ...]] = list(itertools.combinations(sources, 2))
    if is_wide:
        units = {**machine.states, **machine.inputs}
        for one, other in itertools.combinations(list(sources), 2):
            values = sources[one] - sources[other]
            if units[one] == units[other] and _moves(values):
                sources[f"{one} - {other}"] = values
        products = _wide_products(list(sources))
    found: list[FreeTerm] = []
    for port in machine.ports:
        for name, values in sources.items():
            found += _of_source(port.name, port.force_sd, name, values)
        for chosen in products:
            size = port.force_sd / max(rms(np.prod([sources[one] for one in chosen], axis=0)), 1e-300)
            text = ", ".join(f'"{one}"' for one in chosen)
            found.append(
                FreeTerm(
                    effect=product(port.name, sources=chosen, size=size),
                    code=f'effects.product("{port.name}", sources=({text}), size={size:.3g})',
                )
            )
    unique: dict[str, FreeTerm] = {}
    for candidate in found:
        # Every source has the same constant.
        unique.setdefault(strength_of(machine, candidate)[0], candidate)
    return list(unique.values())


def usual_sources(machine: StateModel, problem: Problem, at: MachineFit) -> dict[str, Array]:
    """Return all values of each state and input that moves, in the runs at a fit."""
    series = machine.trajectories(problem.sites, *split_point(at.fit.point))
    found = {
        name: np.concatenate([one[name] for one in series]) for name in (*machine.states, *machine.inputs)
    }
    return {name: values for name, values in found.items() if _moves(values)}


def _wide_products(sources: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the products of two sources that have no state or input in common, with powers up to 3."""
    pairs = [
        (one, other)
        for one, other in itertools.combinations(sources, 2)
        if not set(one.split(MINUS)) & set(other.split(MINUS))
    ]
    return [
        (one,) * power + (other,) * other_power
        for one, other in pairs
        for power, other_power in ((1, 1), (1, 2), (2, 1), (1, 3), (3, 1))
    ]


def _of_source(port: str, force_sd: float, name: str, values: Array) -> list[FreeTerm]:
    scale = rms(values)
    is_one_sided = bool(values.min() >= 0.0 or values.max() <= 0.0)
    found = []
    for form, (_, _, function) in FORMS.items():
        if is_one_sided and form in ("sign", "signed_square", "size"):
            continue
        size = force_sd / max(rms(function(values, scale)), 1e-300)
        code = f'effects.term("{port}", source="{name}", form="{form}", size={size:.3g}, scale={scale:.3g})'
        found.append(FreeTerm(effect=term(port, source=name, form=form, size=size, scale=scale), code=code))
    for place in (
        MACHINES.terms.threshold * float(values.max()),
        MACHINES.terms.threshold * float(values.min()),
    ):
        if abs(place) > 0.1 * scale:
            size = force_sd / max(abs(place), 1e-300)
            code = f'effects.threshold("{port}", source="{name}", place={place:.3g}, size={size:.3g})'
            found.append(FreeTerm(effect=threshold(port, source=name, place=place, size=size), code=code))
    return found


def search_terms(
    machine: StateModel, problem: Problem, terms: Sequence[FreeTerm], at: MachineFit
) -> list[FittedTerm]:
    """Return the terms that explain most, the best first."""
    known = {card.name for card in machine.effects}
    terms = [one for one in terms if strength_of(machine, one)[0] not in known]
    effects = [*machine.port_effects, *(one.effect for one in terms)]
    wider = machine.with_effects(effects)
    own = Problem(wider, problem.observations, problem.held)
    cards = {card.name: card for card in wider.effects}
    kept = [cards[name] for name in at.names]
    names = [strength_of(machine, one)[0] for one in terms]
    fits = MachineFits(own, [*kept, *(cards[name] for name in names)])
    search = MachineSearch(fits, lambda _: None)
    ranked = ranked_scores(search.scores(at))[: MACHINES.terms.most_fitted]
    chosen: list[Score] = [score for score in ranked if score.direction.name in names]
    # The strength that each has to first order.
    starts = [{**at.fit.point, cards[one.direction.name].strength_key: one.strength} for one in chosen]
    fitted = fits.fit_all(
        [((*at.names, one.direction.name), {}, start) for one, start in zip(chosen, starts, strict=True)],
        is_near=True,
    )
    fits.fit_all([(at.names, {}, at.fit.point)])
    by_name = dict(zip(names, terms, strict=True))
    # As laws they are compared beside the base parameters alone: an effect of the fit is one of them, too.
    beside = _beside_base(at)
    effects_scores = score_effects(MachineFits(problem, machine.effects), beside)
    plain, directions = beside.decorrelated, [one.direction for one in chosen]
    laws = {one.direction.name: one for one in score_all(plain.fit, plain.noise, directions, is_steady=True)}
    found = []
    for score, one in zip(chosen, fitted, strict=True):
        name = score.direction.name
        evidence = next(item for item in search.evidence(one) if item.name == name)
        similar = [(abs(cosine(laws[name], other)), other.direction.name) for other in effects_scores]
        alike, closest = max(similar, default=(0.0, ""))
        found.append(
            FittedTerm(
                term=by_name[name], fit=one, objection=evidence.objection, closest=closest, cosine=alike
            )
        )
    return sorted(found, key=lambda item: item.fit.merit)


def _beside_base(at: MachineFit) -> MachineFit:
    """Return a fit whose effects absorb nothing of what others change."""
    is_base = np.array([0.0 if item.key.effect else 1.0 for item in at.fit.free])
    return replace(at, names=(), fit=replace(at.fit, jacobian=at.fit.jacobian.scaled(is_base)))


def strength_of(machine: StateModel, candidate: FreeTerm) -> tuple[str, Parameter]:
    """Return the equation of a candidate and its coefficient."""
    card = candidate.effect.build(machine.signal_units)
    return card.name, card.parameters[0]


def _moves(values: Array) -> bool:
    return bool(
        np.isfinite(values).all() and np.ptp(values) > STILL * max(float(np.abs(values).max()), 1e-300)
    )
