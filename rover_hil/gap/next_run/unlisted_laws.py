"""Smooth laws that nobody listed, drawn at random: causes that one of the list may imitate.

A random force alone is a poor picture of "something else": it follows no state, so that no explanation can
follow it. A law that is missing in the list does follow a state. Each drawn law takes the place of one effect
of the best explanation and is fitted to the measured runs, which gives its size.
"""

from collections.abc import Mapping

import numpy as np

from rover_hil.drives.arrays import rms
from rover_hil.gap.data.problem import Point, Problem
from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.free_terms import usual_sources
from sim_backends.models.interface import Array, Machine
from sim_backends.state_model.effects.cards import card, state, strength
from sim_backends.state_model.model import StateModel, has_ports
from sim_backends.state_model.port_effect import PortEffect


def draw_laws(findings: MachineFindings, rng: np.random.Generator) -> list[tuple[str, Machine, MachineFit]]:
    """Return drawn laws, each with the model that has it and its fit to the measured runs."""
    machine = findings.machine
    if not has_ports(machine):
        return []
    best, point = findings.best, findings.best.fit.point
    sources = usual_sources(machine, findings.problem, findings.best)
    sources = {name: values for name, values in sources.items() if name in machine.states}
    if not sources:
        return []
    laws = {
        f"law {index + 1}": _drawn(f"law {index + 1}", machine, sources, rng)
        for index in range(MACHINES.hypotheses.laws)
    }
    wider = machine.with_effects([*machine.port_effects, *laws.values()])
    options: list[tuple[tuple[str, ...], dict[str, dict[str, float]], Point]] = []
    for name in laws:
        kept = list(best.names)
        if kept:
            kept.pop(int(rng.integers(len(kept))))
        begin: Point = {key: value for key, value in point.items() if not key.effect or key.effect in kept}
        options.append(((*kept, name), {}, begin))
    fits = MachineFits(Problem(wider, findings.problem.observations), wider.effects).fit_all(options)
    return [
        (name, machine.with_effects([*machine.port_effects, law]), fit)
        for (name, law), fit in zip(laws.items(), fits, strict=True)
    ]


def _drawn(
    name: str, machine: StateModel, sources: Mapping[str, Array], rng: np.random.Generator
) -> PortEffect:
    """Return a power of a state with a random exponent, odd or even, or what is beyond a random value."""
    port = machine.ports[int(rng.integers(len(machine.ports)))]
    source = list(sources)[int(rng.integers(len(sources)))]
    values = sources[source]
    scale, is_odd = rms(values), bool(rng.uniform() < 0.5)
    exponent = float(rng.uniform(*MACHINES.hypotheses.law_exponents))
    place = float(rng.uniform(values.min(), values.max()))
    is_power = bool(rng.uniform() < MACHINES.hypotheses.law_powers)

    def value(x: Array) -> Array:
        if not is_power:
            return np.maximum(x - place, 0.0) / scale
        size: Array = (np.abs(x) / scale) ** exponent
        return np.sign(x) * size if is_odd else size

    sentence, size = (
        f"A law of {source} is missing in {port.name}.",
        port.force_sd / max(rms(value(values)), 1e-9),
    )
    coefficient = strength("coefficient", port.unit, size, is_signed=True)
    return PortEffect(
        port=port.name,
        build=card(name, sentence, port.name, lambda _: (coefficient,), (), "", "drawn"),
        change=lambda before, x, v, _: before + v.coefficient * value(state(x, source)),
        states=(source,),
    )
