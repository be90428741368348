"""Orders in which effects act at one port: each is an explanation of its own.

An offset before a dead zone is not one behind it. Effects act in the order in which the model lists them; for
explanations with several effects at one port, input or channel the other orders are fitted too.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rover_hil.drives.arrays import rms
from rover_hil.gap.data.problem import Problem
from rover_hil.gap.evidence.evidence import MachineFit, Names
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.noise.sensor_noise import declared_noise
from rover_hil.gap.parameters import MACHINES
from sim_backends.state_model.model import StateModel
from sim_backends.state_model.port_effect import Action


def other_orders(
    machine: StateModel, problem: Problem, fits: Sequence[MachineFit]
) -> list[tuple[StateModel, MachineFit]]:
    """Return explanations with their effects in another order, each with the model that has this order.

    Those of the best explanations with several effects at one place are fitted; an order that changes no
    prediction is left out.
    """
    options = [
        (wider, one)
        # The fewest effects first: with a third effect the wrong order of two fits better than without.
        for one in sorted(fits, key=lambda one: (len(one.names), one.merit))
        for wider in _orders(machine, one.names)
        if _moves(wider, problem, one)
    ][: MACHINES.search.most_orders]
    found = []
    for wider, one in options:
        own = Problem(wider, problem.observations, problem.held, problem.released)
        found.append((wider, MachineFits(own, wider.effects).best(one.names, {}, one.fit.point)))
    return found


def order_at_ports(machine: StateModel, names: Sequence[str]) -> dict[str, list[str]]:
    """Return the effects of an explanation at each place where several act, in their order."""
    found: dict[str, list[str]] = {}
    for effect, card in zip(machine.port_effects, machine.effects, strict=True):
        if card.name in names and effect.action is not Action.RELEASE:
            found.setdefault(effect.port, []).append(card.name)
    return {port: several for port, several in found.items() if len(several) > 1}


def _orders(machine: StateModel, names: Names) -> Iterator[StateModel]:
    """Return the model with the effects of each place in each other order."""
    for several in order_at_ports(machine, names).values():
        for order in itertools.islice(itertools.permutations(several), 1, None):
            yield _reordered(machine, dict(zip(several, order, strict=True)))


def _reordered(machine: StateModel, instead: Mapping[str, str]) -> StateModel:
    """Return the model with effects in the places of others."""
    by_name = {card.name: effect for card, effect in zip(machine.effects, machine.port_effects, strict=True)}
    return machine.with_effects([by_name[instead.get(name, name)] for name in by_name])


def _moves(wider: StateModel, problem: Problem, found: MachineFit) -> bool:
    """Return True where another order changes the prediction at the same parameters."""
    own = Problem(wider, problem.observations, problem.held, problem.released)
    sd = declared_noise(problem.observations).row_sd
    change = (own.predict(found.fit.point) - problem.predict(found.fit.point)) / sd
    return rms(np.nan_to_num(change)) > MACHINES.decide.same_order
