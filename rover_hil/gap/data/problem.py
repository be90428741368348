"""Measured values and predictions, stacked into vectors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from rover_hil.gap.data.derivatives import Derivatives
from rover_hil.gap.data.derivatives import Indices as Indices
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Array, Channel, EffectCard, Machine, Model, Parameter, Run
from sim_backends.models.parameter_key import ParameterKey

Point: TypeAlias = Mapping[ParameterKey, float]
LARGEST = 1e150
"""Derivatives from here on are those of a machine that runs away; they cannot be squared."""
VALUES_AT_ONCE = 4_000_000
"""Predicted values that are made together, and that are kept for later use."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Free:
    """A fitted parameter, with its prior and the step of its derivatives."""

    key: ParameterKey
    mean: float
    sd: float
    lower: float
    upper: float
    start: float
    step: float

    def at(self, pull: float) -> float:
        """Return the value this many prior deviations from the mean, inside the bounds."""
        return float(np.clip(self.mean + self.sd * pull, self.lower, self.upper))

    def pull_in(self, point: "Point") -> float:
        """Return how far a point is from the mean, in prior deviations; the start where it has no value."""
        return (point.get(self.key, self.start) - self.mean) / self.sd


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Runs under equal conditions; of a series each run is its own group."""

    site: Run
    runs: tuple[Run, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Observations:
    """All values, one row each.

    Attributes:
        groups: One predicted site per group.
        channels: In the order of `channel`.
        values: Measured; the mean over the runs of a steady group.
        site: Index of the group of each row.
        channel: Index of the channel of each row.
        counts: Runs behind each row.
        is_steady: One value per run and channel.
    """

    groups: tuple[Group, ...]
    channels: tuple[Channel, ...]
    values: Array
    site: Indices
    channel: Indices
    counts: Array
    is_steady: bool

    @property
    def run_count(self) -> int:
        """Number of runs."""
        return sum(len(group.runs) for group in self.groups)


def condition_key(model: Model, run: Run) -> tuple[float, ...]:
    """Return the key that replicates have in common."""
    return tuple(round(float(run.conditions[name]), 9) for name in model.condition_units)


def is_steady(runs: Sequence[Run]) -> bool:
    """Return True where every run has one value per channel."""
    return all(values.size == 1 for run in runs for values in run.measured.values())


def group_runs(model: Model, runs: Sequence[Run]) -> tuple[Group, ...]:
    """Put runs under equal conditions together, in the order of their first appearance."""
    if not is_steady(runs):
        return tuple(Group(site=run, runs=(run,)) for run in runs)
    groups: dict[tuple[float, ...], list[Run]] = {}
    for run in runs:
        groups.setdefault(condition_key(model, run), []).append(run)
    return tuple(Group(site=_mean_run(members), runs=tuple(members)) for members in groups.values())


def _mean_run(runs: Sequence[Run]) -> Run:
    names = dict.fromkeys(name for run in runs for name in run.measured)
    means = {
        name: np.array([np.mean([run.measured[name][0] for run in runs if name in run.measured])])
        for name in names
    }
    return replace(runs[0], measured=means)


def observe(model: Model, runs: Sequence[Run]) -> Observations:
    """Stack the measured values of `runs`."""
    groups = group_runs(model, runs)
    values, site, channel, counts = [], [], [], []
    for site_index, group in enumerate(groups):
        for channel_index, item in enumerate(model.channels):
            series = group.site.measured.get(item.name)
            if series is None:
                continue
            values.append(np.asarray(series, dtype=np.float64))
            site.append(np.full(series.size, site_index, dtype=np.intp))
            channel.append(np.full(series.size, channel_index, dtype=np.intp))
            count = sum(1 for run in group.runs if item.name in run.measured)
            counts.append(np.full(series.size, float(count)))
    return Observations(
        groups=groups,
        channels=tuple(model.channels),
        values=np.concatenate(values),
        site=np.concatenate(site),
        channel=np.concatenate(channel),
        counts=np.concatenate(counts),
        is_steady=is_steady(runs),
    )


def cells(observations: Observations) -> list[Indices]:
    """Return the rows of each series: of one channel in one run."""
    change = np.flatnonzero((np.diff(observations.site) != 0) | (np.diff(observations.channel) != 0)) + 1
    return [rows.astype(np.intp) for rows in np.split(np.arange(observations.values.size), change)]


class Problem:
    """A model and observations; predictions are cached.

    Args:
        model: The simulator.
        observations: Measured values.
        held: Base parameters that are not fitted, and their values.
        released: Base parameters whose prior is as wide as that of an effect.
    """

    def __init__(
        self,
        model: Model,
        observations: Observations,
        held: Mapping[str, float] | None = None,
        released: Sequence[str] = (),
    ) -> None:
        self.model = model
        self.observations = observations
        self.held = dict(held or {})
        self.released = tuple(released)
        self.evaluations = 0
        self.sites = [group.site for group in observations.groups]
        self._memory: dict[frozenset[tuple[ParameterKey, float]], Array] = {}
        self._owned: dict[ParameterKey, NDArray[np.bool_]] = {}

    @property
    def owner(self) -> Indices:
        """The number of the unit under test of each row where units differ, else of its run."""
        cards = [card.parameters[0] for card in self.model.effects]
        scattering = [
            one for one in (*self.model.parameters, *cards) if one.scatter_sd > 0.0 and one.scatter_by
        ]
        if not scattering:
            return self.observations.site
        labels = [scattering[0].owner_in(site) for site in self.sites]
        if len(set(labels)) < DATA.runs.least_units:
            return self.observations.site
        numbers: Indices = np.unique(labels, return_inverse=True)[1].astype(np.intp)
        return numbers[self.observations.site]

    def predict(self, point: Point) -> Array:
        """Return the prediction of every row; NaN where the model has no solution."""
        memory_key = _memory_key(point)
        if memory_key not in self._memory:
            self.prepare_points([point])
        return self._memory[memory_key]

    def prepare_points(self, points: Sequence[Point]) -> None:
        """Predict at several points at once, for later use."""
        new = {_memory_key(point): point for point in points}
        new = {key: point for key, point in new.items() if key not in self._memory}
        self.evaluations += len(new)
        if (len(self._memory) + len(new)) * self.observations.values.size > VALUES_AT_ONCE:
            self._memory = {key: self._memory[key] for key in map(_memory_key, points) if key in self._memory}
        self._memory.update(zip(new, self.predictions(list(new.values())), strict=True))

    def predictions(self, points: Sequence[Point]) -> list[Array]:
        """Return the predictions at several points, which are not kept; not too many are made at once."""
        at_once = max(VALUES_AT_ONCE // self.observations.values.size, 1)
        return [
            row
            for first in range(0, len(points), at_once)
            for row in predict_points(self.model, self.sites, points[first : first + at_once])
        ]

    def prepare_derivatives(self, pairs: Sequence[tuple[Point, Free]]) -> None:
        """Predict what `derivative` needs at several points, all at once."""
        self.prepare_points(
            [{**point, item.key: value} for point, item in pairs for value in _sides(point, item)]
        )

    def derivatives(self, point: Point, free: Sequence[Free]) -> Array:
        """Return the change of every row per unit of each parameter: rows x parameters.

        It is a difference inside the bounds. A parameter of single runs is moved in all runs at once.
        """
        request = DerivativeRequest(self, point, free)
        self.prepare_points(request.points)
        return request.matrix([self.predict(one) for one in request.points]).dense()

    def derivative(self, point: Point, free: Free) -> Array:
        """Return the change of every row per unit of one parameter."""
        column: Array = self.derivatives(point, [free])[:, 0]
        return column

    def base_free(self, leave_out: Sequence[str] = (), names: Sequence[str] = ()) -> list[Free]:
        """Return the uncertain base parameters but some, and the unknowns of each run; see `run_free`."""
        found = [
            Free(
                key=ParameterKey(name=item.name),
                mean=item.nominal,
                sd=(DATA.fit.weak if item.name in self.released else 1.0) * item.prior_sd,
                lower=item.lower,
                upper=item.upper,
                start=item.nominal,
                step=DATA.fit.step_share * item.prior_sd,
            )
            for item in self.model.parameters
            if item.prior_sd > 0.0
            and item.lower < item.upper
            and item.name not in leave_out
            and item.name not in self.held
        ]
        return [*found, *self.run_free(names)]

    def run_free(self, names: Sequence[str] = ()) -> list[Free]:
        """Return the unknowns of each run, and its deviations: strengths of these effects may scatter too."""
        if not isinstance(self.model, Machine):
            return []
        strengths = [(card.name, card.parameters[0]) for card in self.model.effects if card.name in names]
        scattering = [("", item) for item in self.model.parameters] + strengths
        return [
            *self._run_unknowns(self.model),
            *(
                one
                for effect, item in scattering
                if item.scatter_sd > 0.0
                for one in self.deviations(item, item.scatter_sd, effect)
            ),
        ]

    def deviations(self, parameter: Parameter, sd: float, effect: str = "") -> list[Free]:
        """Return the deviation of each run, or unit under test, from a parameter or one of an effect."""
        keys = [parameter.deviation_in(site, effect) for site in self.sites]
        found = []
        for key in dict.fromkeys(keys):
            self._owned[key] = np.array([one == key for one in keys])
            found.append(
                Free(
                    key=key,
                    mean=0.0,
                    sd=sd,
                    lower=-np.inf,
                    upper=np.inf,
                    start=0.0,
                    step=DATA.fit.step_share * (parameter.prior_sd or sd),
                )
            )
        return found

    def sites_of(self, key: ParameterKey) -> "NDArray[np.bool_]":
        """Return which sites belong to the run, or to the unit under test, that a parameter is of."""
        if key not in self._owned:
            self._owned[key] = np.array([not key.run or site.name == key.run for site in self.sites])
        return self._owned[key]

    def rows_of(self, key: ParameterKey) -> "NDArray[np.bool_]":
        """Return which rows belong to these sites."""
        return self.sites_of(key)[self.observations.site]

    def _run_unknowns(self, model: Machine) -> list[Free]:
        return [
            Free(
                key=item.key_in(site),
                mean=item.nominal_in(site),
                sd=max(spread, item.prior_sd) if item.is_read_in(site) else item.prior_sd,
                lower=item.lower,
                upper=item.upper,
                start=item.nominal_in(site),
                step=DATA.fit.step_share * item.prior_sd,
            )
            for item in model.run_parameters
            for spread in (self._spread(item.channel),)
            for site in self.sites
        ]

    def _spread(self, channel: str) -> float:
        """Return how far readings of a channel are apart: its first one is known no better from elsewhere."""
        read = np.concatenate([site.measured.get(channel, np.zeros(0)) for site in self.sites])
        good = read[np.isfinite(read)]
        return float(np.std(good)) if good.size else 0.0


class DerivativeRequest:
    """The points that derivatives need, but for the known ones, and the derivatives from predictions."""

    def __init__(
        self,
        problem: Problem,
        point: Point,
        free: Sequence[Free],
        known: Mapping[ParameterKey, Array] | None = None,
        predicted: Array | None = None,
    ) -> None:
        self._problem = problem
        self._free = free
        self._known = known or {}
        self._widths: list[float] = []
        moves: dict[ParameterKey, tuple[Point, Point]] = {}
        for item in free:
            if item.key in self._known:
                self._widths.append(1.0)
                continue
            low, high = _sides(point, item)
            shared = item.key.shared
            below, above = moves.get(shared, (point, point))
            moves[shared] = ({**below, item.key: low}, {**above, item.key: high})
            self._widths.append(high - low)
        # The point itself is one side of most of them.
        self._known_rows = [] if predicted is None else [predicted]
        different = {_memory_key(one): one for one in [point] * len(self._known_rows)}
        different |= {_memory_key(one): one for pair in moves.values() for one in pair}
        self.points: list[Point] = list(different.values())[len(self._known_rows) :]
        order = {key: index for index, key in enumerate(different)}
        self._sides = {
            shared: (order[_memory_key(low)], order[_memory_key(high)])
            for shared, (low, high) in moves.items()
        }

    def matrix(self, rows: Sequence[Array]) -> Derivatives:
        """Return rows x parameters, given the predictions at `points`."""
        rows = [*self._known_rows, *rows]
        site = self._problem.observations.site
        shared = [item.key.shared for item in self._free]
        packed = {key: column for column, key in enumerate(dict.fromkeys(shared))}
        values = np.zeros((site.size, len(packed)))
        places = np.full((len(self._problem.sites), len(packed)), -1, dtype=np.intp)
        widths = np.ones(places.shape)
        for index, item in enumerate(self._free):
            column, owned = packed[shared[index]], self._problem.sites_of(item.key)
            places[owned, column], widths[owned, column] = index, self._widths[index]
        for item in self._free:
            if item.key in self._known:
                owned = self._problem.rows_of(item.key)
                values[owned, packed[item.key.shared]] = self._known[item.key][owned]
        for key, (low, high) in self._sides.items():
            column = packed[key]
            with np.errstate(over="ignore", invalid="ignore"):  # of a machine that runs away
                change = (rows[high] - rows[low]) / widths[site, column]
            here = (np.abs(change) < LARGEST) & (places[site, column] >= 0)
            values[here, column] = change[here]
        return Derivatives(values=values, site=site, places=places, count=len(self._free))


def _memory_key(point: Point) -> frozenset[tuple[ParameterKey, float]]:
    return frozenset(point.items())


def _sides(point: Point, free: Free) -> tuple[float, float]:
    here = point.get(free.key, free.start)
    low, high = max(here - free.step, free.lower), min(here + free.step, free.upper)
    if not free.key.is_of_effect or low == here or high == here:
        # For a smooth parameter or one with a sign, one side is enough and costs half.
        other = high if high > here else low
        low, high = min(here, other), max(here, other)
    return low, high


def predict_points(model: Model, sites: Sequence[Run], points: Sequence[Point]) -> list[Array]:
    """Return the predictions for `sites` at several points, each in the order of `observe`."""
    values = [split_point(point) for point in points]
    if isinstance(model, Machine):
        found = model.predict_points(sites, values) if values else []
    else:
        found = [model.predict(sites, parameters, effects) for parameters, effects in values]
    return [
        np.concatenate(
            [
                np.asarray(table[channel.name], dtype=np.float64).reshape(-1)
                for site, table in zip(sites, tables, strict=True)
                for channel in model.channels
                if channel.name in site.measured
            ]
        )
        for tables in found
    ]


def split_point(point: Point) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Return the base parameters and the effects of a point."""
    parameters: dict[str, float] = {}
    effects: dict[str, dict[str, float]] = {}
    for key, value in point.items():
        if key.is_of_effect:
            effects.setdefault(key.effect, {})[key.name] = value
        else:
            parameters[key.text] = value
    return parameters, effects


def effect_free(card: EffectCard, shapes: Mapping[str, float] | None = None) -> list[Free]:
    """Return the parameters of an effect: a weakly held strength first, then its shapes."""
    frees = []
    for index, item in enumerate(card.parameters):
        start = (shapes or {}).get(item.name, item.nominal)
        frees.append(
            Free(
                key=ParameterKey(effect=card.name, name=item.name),
                mean=item.nominal if index == 0 else start,
                sd=(DATA.fit.weak if index == 0 else 1.0) * item.prior_sd,
                lower=item.lower,
                upper=item.upper,
                start=start,
                step=DATA.fit.effect_step_share * item.prior_sd,
            )
        )
    return frees
