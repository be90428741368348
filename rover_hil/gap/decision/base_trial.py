"""Base parameters of a machine, and what explains its runs where one of them is nominal."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rover_hil.gap.data.problem import Problem
from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.decision.decide import is_same_law
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.score import one_sided_z
from rover_hil.gap.evidence.sizes import size_of
from rover_hil.gap.fit.base_parameters import FAR_SD, Trial, far
from rover_hil.gap.fit.holdout import hold_out
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.fit.released_fit import released_fit
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.free_terms import free_terms, search_terms, strength_of
from rover_hil.gap.search.search import ranked_scores, score_effects
from rover_hil.gap.verdict import FittedBase
from sim_backends.models.interface import Machine, Run
from sim_backends.models.parameter_key import ParameterKey
from sim_backends.state_model.model import StateModel, has_ports


def machine_bases(findings: MachineFindings, found: MachineFit) -> list[FittedBase]:
    """Return the base parameters of a fit with their intervals."""
    items = {item.name: item for item in findings.machine.parameters}
    rows = []
    for free in found.fit.free:
        name = free.key.name
        if not free.key.is_base or name not in items:
            continue
        size, item = size_of(found, free.key), items[name]
        rows.append(
            FittedBase(
                name=name,
                unit=item.unit,
                nominal=item.nominal,
                prior_sd=item.prior_sd,
                value=size.value,
                ci95=(size.low, size.high),
                pull=(size.value - item.nominal) / item.prior_sd,
            )
        )
    return rows


def machine_trial(
    findings: MachineFindings,
    problem: Problem,
    found: MachineFit,
    locked: Sequence[Run],
    seed: int,
    name: str,
) -> Trial:
    """Return what the runs say of a base parameter, compared with its nominal value.

    The problem is that which the fit solves, without the priors that it contradicts.
    """
    machine = findings.machine
    nominal = {item.name: item.nominal for item in machine.parameters}
    kept = {name: nominal[name]}
    held = Problem(machine, problem.observations, kept, problem.released)
    cards = [card for card in machine.effects if card.releases != name]
    begin = {key: value for key, value in found.fit.point.items() if key != ParameterKey(name=name)}
    fits = MachineFits(held, cards)
    part = fits.best(found.names, {}, begin)
    # Compared with a fit at the nominal value in which what takes its place stays at the end of its prior.
    before, pushed = part, tuple(_pushed(findings, part, problem))
    while more := _pushed(findings, before, problem):
        kept |= more
        before = _with_kept(before, problem, kept)
    is_as_good: Callable[[MachineFit], bool] = partial(_is_as_good, machine, found=found, before=before)
    replaced, freed = released_fit(held, part)
    others = tuple(one for one in freed.released if one not in problem.released)
    if pushed and is_as_good(part):
        replaced, others = part, pushed
    equals: list[tuple[str, ...]] = [others] if is_as_good(replaced) else []
    sizes = {
        others: " and ".join(f"{one} ({_size_text(replaced, ParameterKey(name=one))})" for one in others)
    }
    if not is_as_good(part):
        # An effect that sets one of the others free is the same explanation.
        fits.cards = {card.name: card for card in cards if card.releases not in others}
        ranked = ranked_scores(score_effects(fits, part))
        chosen = [one.direction for one in ranked[: MACHINES.terms.most_fitted] if one_sided_z(one) > 0.0]
        options = [((*found.names, one.name), {one.name: one.shapes}, part.fit.point) for one in chosen]
        rivals = fits.fit_all(options)
        good = [one for one in rivals if is_as_good(one)]
        equals += [one.names for one in good]
        sizes |= {
            one.names: " and ".join(_effect_text(fits, one, effect) for effect in one.names) for one in good
        }
    if not equals and has_ports(machine):
        equals += _terms(_held_machine(machine, name), held, found, part, is_as_good)
    holdout = hold_out(machine, locked, before, found, np.random.default_rng(seed))
    return Trial(equals=tuple(equals), closure=holdout.closure, improved=holdout.improved, sizes=sizes)


def _pushed(findings: MachineFindings, part: MachineFit, problem: Problem) -> dict[str, float]:
    """Return the base parameters within whose priors a fit cannot stay, at the end of their priors."""
    return {
        row.name: row.nominal + math.copysign(FAR_SD * row.prior_sd, row.pull)
        for row in far(machine_bases(findings, part))
        if row.name not in problem.released
    }


def _with_kept(part: MachineFit, problem: Problem, kept: Mapping[str, float]) -> MachineFit:
    """Return a fit with base parameters held at given values."""
    held = Problem(problem.model, problem.observations, kept, problem.released)
    begin = {key: value for key, value in part.fit.point.items() if key.name not in kept}
    return MachineFits(held, problem.model.effects).best(part.names, {}, begin)


def _effect_text(fits: MachineFits, found: MachineFit, effect: str) -> str:
    card = fits.cards[effect]
    item = card.parameters[0]
    unit = "" if item.unit == "1" else f" {item.unit}"
    return f"{effect} ({item.name} {_size_text(found, card.strength_key, unit)})"


def _size_text(found: MachineFit, key: ParameterKey, unit: str = "") -> str:
    size = size_of(found, key)
    return f"{size.value:.3g}{unit}, {size.low:.3g} to {size.high:.3g}"


def _held_machine(machine: StateModel, name: str) -> StateModel:
    known = (replace(item, prior_sd=0.0) if item.name == name else item for item in machine.parameters)
    return replace(machine, parameters=tuple(known))


def _is_as_good(machine: Machine, rival: MachineFit, found: MachineFit, before: MachineFit) -> bool:
    """Return True where left-out runs do not prefer the fitted value to an explanation without it.

    One with more causes, which together are farther from what was known, is no rival.
    """
    if all(one > own for one, own in zip(_causes(machine, rival), _causes(machine, found), strict=True)):
        return False
    if rival.is_within_noise and found.is_within_noise:
        return True
    if rival.merit <= found.merit:
        return True
    gain, most = before.error - rival.error, before.error - found.error
    return found.evidence.gains_alike(gain, most) and rival.is_equal(found)


def _causes(machine: Machine, found: MachineFit) -> tuple[int, float]:
    """Return how many effects and base parameters far from nominal a fit has, and their squared pulls."""
    pulls = [
        (found.fit.point[key] - item.nominal) / item.prior_sd
        for item in machine.parameters
        if (key := ParameterKey(name=item.name)) in found.fit.point
    ]
    squares = [one**2 for one in pulls if abs(one) > FAR_SD] + [FAR_SD**2] * len(found.names)
    return len(squares), sum(squares)


def _terms(
    machine: StateModel,
    held: Problem,
    found: MachineFit,
    part: MachineFit,
    is_as_good: Callable[[MachineFit], bool],
) -> list[tuple[str, ...]]:
    """Return the free-form terms that replace the fitted value: another law, or one that explains more."""
    terms = free_terms(machine, held, part)
    return [
        (strength_of(machine, one.term)[0],)
        for one in search_terms(machine, held, terms, part)
        if not one.objection
        and not (is_same_law(one.fit, found, part) and found.is_equal(one.fit))
        and is_as_good(one.fit)
    ]
