"""Nature's integration: Heun's method in fine steps, all runs at once."""

from collections.abc import Sequence

import numpy as np

from tests.nature.hidden_machines.effect import Effect
from tests.nature.hidden_machines.machine import Array, Machine, Push, Values

Hidden = Sequence[tuple[Effect, float]]
"""Effects with their strengths, in the order in which a signal passes them."""


def simulate(machine: Machine, numbers: Values, starts: Values, inputs: Values, hidden: Hidden) -> Values:
    """Return each channel without noise, of shape (runs, samples).

    `numbers` holds base parameters and conditions, `starts` first values of states, each of shape (runs,);
    `inputs` holds series of shape (runs, samples).
    """
    dt = machine.step_s / machine.substeps
    p = _changed(numbers, hidden)
    fine = {
        name: _series(np.repeat(series, machine.substeps, axis=1), "input", name, dt, hidden)
        for name, series in inputs.items()
    }
    runs, steps = next(iter(fine.values())).shape
    x = {name: starts.get(name, np.zeros(runs)) for name in machine.states}
    path = {name: np.empty((runs, steps)) for name in machine.states}
    for k in range(steps):
        u = {name: series[:, k] for name, series in fine.items()}
        for name, value in x.items():
            path[name][:, k] = value
        x = _heun(machine, x, u, p, k * dt, dt, hidden)
    columns = {name: value[:, None] for name, value in p.items()}
    channels = machine.outputs(path, fine, columns)
    return {
        name: _series(series, "channel", name, dt, hidden)[:, :: machine.substeps]
        for name, series in channels.items()
    }


def _changed(numbers: Values, hidden: Hidden) -> Values:
    changed = dict(numbers)
    for effect, strength in hidden:
        if effect.where == "parameter":
            changed[effect.place] = changed[effect.place] + strength
    return changed


def _series(series: Array, where: str, name: str, dt: float, hidden: Hidden) -> Array:
    for effect, strength in hidden:
        if effect.where == where and effect.place == name:
            series = effect.act(series, dt, strength)
    return series


def _push(x: Values, u: Values, time_s: float, hidden: Hidden) -> Push:
    """Return what acts at each port at present."""
    at_ports = [(effect, strength) for effect, strength in hidden if effect.where == "port"]
    around = {**x, **u, "time": np.asarray(time_s)}

    def push(place: str, signal: Array) -> Array:
        for effect, strength in at_ports:
            if effect.place == place:
                signal = effect.act(signal, around, strength)
        return signal

    return push


def _heun(
    machine: Machine, x: Values, u: Values, p: Values, time_s: float, dt: float, hidden: Hidden
) -> Values:
    first = machine.rates(x, u, p, _push(x, u, time_s, hidden))
    guess = {name: value + dt * first[name] for name, value in x.items()}
    second = machine.rates(guess, u, p, _push(guess, u, time_s + dt, hidden))
    return {name: value + 0.5 * dt * (first[name] + second[name]) for name, value in x.items()}
