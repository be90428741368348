"""How much of a hidden effect shows: what base parameters and starts cannot take up, over the noise."""

import numpy as np

from tests.nature.hidden_machines.effect import Effect
from tests.nature.hidden_machines.machine import Array, Machine, Values
from tests.nature.hidden_machines.simulate import Hidden, simulate

STEP = 0.3
"""Of a difference quotient, over the prior standard deviation."""
CLOSE = 0.1
"""Relative error of a visibility that is searched for."""


class Sight:
    """What the runs of a machine show of a change in nature."""

    def __init__(self, machine: Machine, numbers: Values, starts: Values, inputs: Values) -> None:
        self._machine, self._numbers, self._starts, self._inputs = machine, numbers, starts, inputs
        self._plain = self.readings(())
        self._columns = self._sensitivities()
        self._fitted = np.linalg.qr(self._columns)[0]

    def readings(self, hidden: Hidden) -> Array:
        """Return all channels over their noise, of shape (channels, runs, samples)."""
        return self._whitened(simulate(self._machine, self._numbers, self._starts, self._inputs, hidden))

    def remainder(self, hidden: Hidden) -> Array:
        """Return what remains of the effects in the readings after the best fit without them.

        A parameter that is wrong itself is not fitted.
        """
        change = (self.readings(hidden) - self._plain).ravel()
        names = [number.name for number in self._machine.numbers]
        wrong = [names.index(effect.place) for effect, _ in hidden if effect.where == "parameter"]
        fitted = np.linalg.qr(np.delete(self._columns, wrong, axis=1))[0] if wrong else self._fitted
        full = np.concatenate([change, np.zeros(fitted.shape[0] - change.size)])
        return np.asarray((full - fitted @ (fitted.T @ full))[: change.size])

    def ratio(self, hidden: Hidden) -> float:
        """Return the root mean square of what remains, over the noise, in the channel that shows most."""
        return self._greatest(self.remainder(hidden))

    def rest(self, hidden: Hidden, other: Effect) -> tuple[float, float]:
        """Return chi-square and `ratio` of what remains where another effect is fitted linearly."""
        rest, rival = self.remainder(hidden), self.remainder([(other, other.typical)])
        share = float(rest @ rival) / max(float(rival @ rival), 1e-12)
        left = rest - (share if other.is_signed else max(share, 0.0)) * rival
        return float(np.sum(left**2)), self._greatest(left)

    def strength(self, effect: Effect, ratio: float, sign: float) -> float:
        """Return the strength, of a sign, that shows by `ratio`, or the greatest that makes sense."""
        strength, low, high = min(effect.typical, effect.most), 0.0, effect.most
        for _ in range(10):
            shown = self.ratio([(effect, sign * strength)])
            if np.isfinite(shown) and abs(np.log(max(shown, 1e-9) / ratio)) < CLOSE:
                break
            if np.isfinite(shown) and shown < ratio:
                low = strength
            else:
                high = strength
            step = float(np.clip(ratio / max(shown, 1e-9), 0.1, 10.0)) if np.isfinite(shown) else 0.1
            guess = strength * step
            strength = guess if low < guess < high else min(0.5 * (low + high), effect.most)
            if not np.isfinite(strength):
                strength = 10.0 * low
        return sign * strength

    def _whitened(self, channels: Values) -> Array:
        return np.stack([channels[sensor.name] / sensor.noise for sensor in self._machine.sensors])

    def _sensitivities(self) -> Array:
        """Return a column per base parameter and per start of a run; prior rows below the readings'."""
        machine, runs = self._machine, next(iter(self._inputs.values())).shape[0]
        steps = {number.name: STEP * number.share_sd * number.nominal for number in machine.numbers}
        noise = {sensor.name: sensor.noise for sensor in machine.sensors}
        begins = {start.state: STEP * noise.get(start.channel, start.spread) for start in machine.starts}
        count = 1 + len(steps) + len(begins)
        numbers = {name: np.tile(value, count) for name, value in self._numbers.items()}
        starts = {name: np.tile(value, count) for name, value in self._starts.items()}
        for place, (name, step) in enumerate(steps.items(), start=1):
            numbers[name][place * runs : (place + 1) * runs] += step
        for place, (name, step) in enumerate(begins.items(), start=1 + len(steps)):
            starts[name][place * runs : (place + 1) * runs] += step
        inputs = {name: np.tile(series, (count, 1)) for name, series in self._inputs.items()}
        every = self._whitened(simulate(machine, numbers, starts, inputs, ()))
        parts = (every.reshape(len(machine.sensors), count, runs, -1) - self._plain[:, None]) / STEP
        columns = [parts[:, 1 + k].ravel() for k in range(len(steps))]
        for place in range(1 + len(steps), count):
            for run in range(runs):
                column = np.zeros_like(self._plain)
                column[:, run] = parts[:, place, run]
                columns.append(column.ravel())
        return np.vstack([np.stack(columns, axis=1), np.eye(len(columns))])

    def _greatest(self, rest: Array) -> float:
        channels = rest.reshape(len(self._machine.sensors), -1)
        return float(np.max(np.sqrt(np.mean(channels**2, axis=1))))
