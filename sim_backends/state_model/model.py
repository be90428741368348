"""A machine as a right-hand side with named ports, integrated for its user."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeGuard

import numpy as np

from drivers.errors import ConfigError
from sim_backends.models.interface import Array, Channel, Model, Parameter, Port, Run, Values
from sim_backends.state_model.equations import Equations
from sim_backends.state_model.integrate import Point, Simulation, is_recordable
from sim_backends.state_model.port_effect import PortEffect

MOST_SUBSTEPS = 32
"""Integration steps per sample, above which a machine is refused as stiff."""
SETTLED_SHARE = 0.75
"""Share of the runs that must not depend on the step where others are at a tipping point."""
SOLVED_SHARE = 0.1
"""Greatest error of the integration, as a share of the sensor noise."""


@dataclass(frozen=True, kw_only=True)
class StateModel(Equations):
    """A `Model` made of equations; see `Equations` for its arguments."""

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict every channel of every run. See `Model.predict`."""
        return self.predict_points(runs, [(parameters, effects)])[0]

    def predict_points(
        self, runs: Sequence[Run], points: Sequence[tuple[Values, Mapping[str, Values]]]
    ) -> list[list[dict[str, Array]]]:
        """Predict at several points at once; NaN without a solution. See `Machine.predict_points`."""
        return self.simulate_points(runs, [Point(values, effects) for values, effects in points])

    def force_responses(
        self,
        runs: Sequence[Run],
        parameters: Values,
        effects: Mapping[str, Values],
        port: Port,
        shapes: Array,
    ) -> list[list[dict[str, Array]]]:
        """Return the change of every channel per unit of a force at a port.

        Args:
            runs: Conditions, inputs and lengths.
            parameters: Where to linearise.
            effects: The same.
            port: Where the force acts.
            shapes: Forces over time: shapes x samples of the longest run.

        Returns:
            Shape, then run: channel to values.
        """
        size = port.force_sd
        points = [Point(parameters, effects)]
        points += [Point(parameters, effects, (port.name, size * shape)) for shape in shapes]
        base, *moved = self.simulate_points(runs, points)
        return [
            [
                {name: (values[name] - before[name]) / size for name in before}
                for values, before in zip(tables, base, strict=True)
            ]
            for tables in moved
        ]

    def trajectories(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Return states and inputs of each run over its samples."""
        point = Point(parameters, effects)
        model = replace(self, substeps=self._needed_substeps(point))
        return Simulation(model, runs, [point]).trajectories()

    def with_effects(self, more: Sequence[PortEffect]) -> "StateModel":
        """Return the same model with only these effects to choose from."""
        return replace(self, port_effects=tuple(more))

    def forced(self, forces: Mapping[str, Mapping[str, Array]]) -> "StateModel":
        """Return the same model with forces that act besides its equations.

        Args:
            forces: Run, then port, to values at the samples.
        """
        return replace(self, known_forces=forces)

    def refined(self, runs: Sequence[Run]) -> "StateModel":
        """Return the same model with enough integration steps for `runs`.

        The steps are halved until the prediction moves by less than 10 % of the sensor noise, at the nominal
        parameters and with each effect at its natural size; only a fast effect costs many steps. Where 32
        steps are not enough with an effect, those count that are enough in three quarters of the runs: with a
        cog or a stop a run may come to rest just at a tipping point, where every small error decides.

        Raises:
            ConfigError: 32 steps per sample are not enough.
        """
        cards = {card.name: card.parameters[0] for card in self.effects}
        points = {"": Point({}, {})}
        points |= {name: Point({}, {name: {one.name: one.natural}}) for name, one in cards.items()}
        found = self._enough_steps(runs, points)
        others = {name: one for name, one in points.items() if name and name not in found}
        if others and "" in found:
            found |= self._enough_steps(runs, others, least_share=SETTLED_SHARE)
        for effect in points:
            if effect not in found:
                raise ConfigError(
                    f"model {self.name}: {MOST_SUBSTEPS} integration steps per sample are not enough"
                    f"{f' with {effect}' if effect else ''}: the equations are stiff; smooth the jumps or "
                    "leave out the fastest part"
                )
        base = found.pop("")
        return replace(self, substeps=base, effect_substeps=found)

    def refined_at(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> "StateModel":
        """Return itself, or with smaller integration steps where those are too large at these values."""
        point = Point(parameters, effects)
        steps = self._enough_steps(runs, {"here": point}).get("here", MOST_SUBSTEPS)
        if steps <= self._needed_substeps(point):
            return self
        if not effects:
            return replace(self, substeps=steps)
        return replace(self, effect_substeps={**self.effect_substeps, **dict.fromkeys(effects, steps)})

    def _enough_steps(
        self, runs: Sequence[Run], points: Mapping[str, Point], least_share: float | None = None
    ) -> dict[str, int]:
        """Return the steps per sample that each point needs; without those for which 32 are not enough."""
        points = dict(points)
        found: dict[str, int] = {}
        substeps = 1
        coarse = self._at_substeps(runs, points, substeps)
        while points and substeps <= MOST_SUBSTEPS:
            fine = self._at_substeps(runs, points, 2 * substeps)
            for name in list(points):
                if self._is_settled(coarse[name], fine[name], least_share):
                    found[name] = substeps
                    del points[name]
            substeps, coarse = 2 * substeps, fine
        for name in points:
            if name and self._runs_away(coarse[name]):
                # No step is small enough here; the other sign, or a smaller size, needs no smaller one.
                found[name] = 1
        return found

    def _is_settled(
        self,
        coarse: Sequence[Mapping[str, Array]],
        fine: Sequence[Mapping[str, Array]],
        least_share: float | None,
    ) -> bool:
        if least_share is None:
            return self._are_close(coarse, fine)
        by_run = [self._are_close([one], [other]) for one, other in zip(coarse, fine, strict=True)]
        return float(np.mean(by_run)) >= least_share

    def _runs_away(self, tables: Sequence[Mapping[str, Array]]) -> bool:
        return not all(np.isfinite(one[channel.name]).all() for one in tables for channel in self.channels)

    def _at_substeps(
        self, runs: Sequence[Run], points: Mapping[str, Point], substeps: int
    ) -> dict[str, list[dict[str, Array]]]:
        model = replace(self, substeps=substeps, effect_substeps={})
        return dict(zip(points, model.simulate_points(runs, list(points.values())), strict=True))

    def _are_close(self, coarse: Sequence[Mapping[str, Array]], fine: Sequence[Mapping[str, Array]]) -> bool:
        return all(self._is_close(channel, coarse, fine) for channel in self.channels)

    def _is_close(
        self, channel: Channel, coarse: Sequence[Mapping[str, Array]], fine: Sequence[Mapping[str, Array]]
    ) -> bool:
        before = np.concatenate([one[channel.name] for one in coarse])
        after = np.concatenate([one[channel.name] for one in fine])
        with np.errstate(all="ignore"):
            scale = channel.noise_sd or 0.02 * float(np.nanstd(after))
            error = float(np.sqrt(np.nanmean((after - before) ** 2)))
        return bool(np.isfinite(before).all()) and error <= SOLVED_SHARE * max(scale, 1e-300)

    def simulate_points(self, runs: Sequence[Run], points: Sequence[Point]) -> list[list[dict[str, Array]]]:
        """Return the channels of each run at each point."""
        found: list[list[dict[str, Array]]] = [[] for _ in points]
        for (substeps, _), places in self._alike(points).items():
            model = replace(self, substeps=substeps)
            tables = Simulation(model, runs, [points[place] for place in places]).tables()
            for place, rows in zip(places, tables, strict=True):
                found[place] = rows
        return found

    def _alike(self, points: Sequence[Point]) -> dict[tuple[int, frozenset[str]], list[int]]:
        """Return the points by the integration steps that their effects need, and by these effects.

        Equations that are called through Python cost nearly the same for one point as for many; there the
        effects do not separate them.
        """
        groups: dict[tuple[int, frozenset[str]], list[int]] = {}
        for place, point in enumerate(points):
            acting = frozenset(self._acting(point)) if self._is_recordable else frozenset[str]()
            groups.setdefault((self._needed_substeps(point), acting), []).append(place)
        return groups

    def _needed_substeps(self, point: Point) -> int:
        needed = [self.effect_substeps.get(name, self.substeps) for name in point.effects]
        return max([self.substeps, *needed])

    def _acting(self, point: Point) -> list[str]:
        """Return the effects that are not at their null."""
        strengths = self._strengths
        return [
            name
            for name, values in point.effects.items()
            if name in strengths
            and values.get(strengths[name].name, strengths[name].nominal) != strengths[name].nominal
        ]

    @cached_property
    def _strengths(self) -> dict[str, Parameter]:
        return {card.name: card.parameters[0] for card in self.effects}

    @cached_property
    def _is_recordable(self) -> bool:
        return is_recordable(self)


def has_ports(model: Model) -> TypeGuard[StateModel]:
    """Return True where forces and free-form terms can act inside a model."""
    return isinstance(model, StateModel) and bool(model.ports)
