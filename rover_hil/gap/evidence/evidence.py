"""A machine fitted with some effects, and what speaks for it: left-out runs, or the likelihood of values."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from scipy import special, stats

from rover_hil.gap.evidence.fit import Fit
from rover_hil.gap.evidence.jackknife import as_normal
from rover_hil.gap.evidence.left_out import LeftOut
from rover_hil.gap.evidence.score import strength_z
from rover_hil.gap.noise.autoregression import Autoregression
from rover_hil.gap.noise.sensor_noise import SensorNoise
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array, EffectCard, Parameter
from sim_backends.models.parameter_key import ParameterKey

Names: TypeAlias = tuple[str, ...]


class Evidence:
    """How explanations are compared: by what others predict of a run; the noise of each sensor is declared.

    Attributes:
        freedom: Degrees of freedom behind the size of the errors.
        is_learned: The noise was learned from the runs, so that a small rest proves nothing.
        slow: Channels whose errors are so slow that they may be errors of the model.
        neighbours: How the errors of neighbouring samples depend on each other; None where they do not count.
        has_budget: The error of each channel is compared with a tolerance.
        least_gain: What each effect of an explanation must gain in twice the logarithm of the density of
            units of observation; None where it must lower the error by more than the tolerance.
    """

    freedom = math.inf
    is_learned = False
    slow: tuple[str, ...] = ()
    neighbours: Autoregression | None = None
    has_budget = True
    least_gain: float | None = None

    def merit(self, found: "MachineFit") -> float:
        """Return minus two log-likelihood of what counts; smaller is better.

        Each left-out run has errors of its own size: one extrapolated badly cannot decide alone.
        """
        counts = found.left_out.counts
        return float(np.sum(counts * np.log(found.left_out.squares / counts)))

    def charge(self, found: Fit, shapes: Sequence[ParameterKey]) -> float:
        """Return what free shapes cost in minus two log-likelihood.

        Nothing: runs that are left out charge for themselves.
        """
        return 0.0

    def most_starts(self) -> int:
        """Return how many starts of a model that can only be called are fitted.

        Several: effects may be large.
        """
        return MACHINES.fit.called_starts

    def z(self, part: "MachineFit", found: "MachineFit", key: ParameterKey) -> float:
        """Return how certain a strength is, as a standard normal; `part` is the fit without its effect.

        Over the scatter of runs.
        """
        left_out = found.left_out
        index = left_out.keys.index(key)
        pull = float(found.fit.pull[[item.key for item in found.fit.free].index(key)])
        z = pull / float(left_out.by_samples[index])
        return math.copysign(as_normal(z, *left_out.scatter(index)), pull)

    def needed(self, found: "MachineFit", share: float) -> tuple[float, float]:
        """Return the least share of the remaining error that an effect explains, and its least certainty.

        Less certainty for what explains much.
        """
        is_clear = share >= MACHINES.search.clear_share
        return MACHINES.search.share, MACHINES.search.clear_z if is_clear else MACHINES.search.least_z

    def explained(self, part: "MachineFit", found: "MachineFit") -> tuple[float, float]:
        """Return the share of the excess error that effects explain, and that of the runs they improve.

        Each run has the weight of its excess error, at most that of its samples: none decides alone.
        """
        before, after = part.left_out.squares, found.left_out.squares
        excess = np.maximum(before - part.left_out.counts, 1e-9)
        weight = np.minimum(excess, part.left_out.counts)
        shares = np.clip((before - after) / excess, -1.0, 1.0)
        total = float(weight.sum())
        return float((weight * shares).sum() / total), float(weight[after < before].sum() / total)

    def explains_most(self, part: "MachineFit", found: "MachineFit") -> bool:
        """Return True where one effect leaves no room for a pair.

        Never: predictions are cheap.
        """
        return False

    def is_imitation(self, found: "MachineFit") -> bool:
        """Return True where large effects nearly cancel, and so imitate a third.

        Never: declared noise and left-out runs distinguish effects from their imitation.
        """
        return False

    def is_equal(self, one: "MachineFit", other: "MachineFit") -> bool:
        """Return True where the first is neither clearly worse than the second nor better.

        By left-out runs, each with the same weight.
        """
        differences = np.log(one.left_out.squares / other.left_out.squares) * np.sqrt(other.left_out.counts)
        if differences.size < 2:
            return True
        spread = float(np.std(differences, ddof=1)) / math.sqrt(differences.size)
        t = abs(float(differences.mean())) / max(spread, 1e-12)
        return t < float(stats.t.ppf(0.5 + 0.5 * MACHINES.search.set_level, differences.size - 1))

    def gains_alike(self, gain: float, best: float) -> bool:
        """Return True where an alternative gains enough.

        Most of what the best gains.
        """
        return gain >= MACHINES.search.set_share * best

    def is_within_noise(self, found: "MachineFit") -> bool:
        """Return True where the declared noise explains what a fit leaves of left-out runs.

        By the errors of left-out runs.
        """
        return found.is_noise

    def determined(self, card: EffectCard) -> tuple[Parameter, ...]:
        """Return the parameters of an effect that runs determine, so that none may be at its limit.

        All.
        """
        return card.parameters

    def half_width(self, found: "MachineFit", index: int) -> float:
        """Return half of the 95 % interval of a parameter of all runs, in prior deviations.

        By the noise of samples and what changes when a run is left out (jackknife, Student's t).
        """
        spread, freedom = found.left_out.scatter(index)
        return float(stats.t.ppf(0.975, freedom)) * spread * float(found.left_out.by_samples[index])

    def misfit_p(self, found: "MachineFit", structure: Callable[[], list[float]]) -> list[float]:
        """Return the probabilities of such a misfit by noise alone; `structure` tests what is slow in it.

        The size of the misfit against the declared noise, and its structure.
        """
        residual = found.errors
        square = float(residual @ residual) / (1.0 + MACHINES.tests.sigma_uncertainty) ** 2
        size_p = float(stats.chi2.sf(square, max(residual.size - len(found.fit.free), 1)))
        return [size_p, *structure()]

    def is_contradicted(self, improved: float, closure: float | None, lean: tuple[float, float]) -> bool:
        """Return True where the locked runs speak against an explanation; see `Holdout`.

        Most locked runs become worse, or all together.
        """
        return improved < 0.5 or (closure is not None and closure < 0.0)

    def share_of_gap(self, closure: float | None, share: float, p_remaining: float) -> float:
        """Return the share of the gap that is explained, on locked runs where that is defined.

        The closure on locked runs.
        """
        return share if closure is None else closure


class LearnedEvidence(Evidence):
    """The same; the noise is learned from the runs, so that a small rest proves nothing."""

    is_learned = True
    least_gain = MACHINES.noise.z**2

    def __init__(self, slow: tuple[str, ...], neighbours: Autoregression) -> None:
        self.slow, self.neighbours = slow, neighbours

    def merit(self, found: "MachineFit") -> float:
        """With the pulls of base parameters, which may have taken the gap on themselves."""
        return super().merit(found) + found.pulls

    def z(self, part: "MachineFit", found: "MachineFit", key: ParameterKey) -> float:
        """A base parameter that an effect releases must also lie beyond its prior."""
        most = math.sqrt(max(part.merit - found.merit, 0.0))
        found = found.decorrelated
        return float(np.clip(strength_z(found.fit, found.noise, key), -most, most))

    def needed(self, found: "MachineFit", share: float) -> tuple[float, float]:
        """More certainty, as the noise is not known."""
        return MACHINES.search.share, MACHINES.noise.z

    def explained(self, part: "MachineFit", found: "MachineFit") -> tuple[float, float]:
        """Base parameters may have taken the gap on themselves, against their priors."""
        gains = part.left_out.squares - found.left_out.squares
        by_pulls = part.pulls - found.pulls
        asked = max(part.error - part.count, 0.0) + part.pulls
        share = float(np.clip((float(gains.sum()) + by_pulls) / max(asked, 1e-9), -1.0, 1.0))
        better = float(gains[gains > 0.0].sum()) + max(by_pulls, 0.0)
        return share, better / max(float(np.abs(gains).sum()) + abs(by_pulls), 1e-300)

    def explains_most(self, part: "MachineFit", found: "MachineFit") -> bool:
        """Predictions are dear, so pairs are left out where nine tenths are explained and noise is left.

        Nine tenths of a gap of thirty times the noise are no reason to stop: a third effect that resembles
        two missing ones explains as much.
        """
        return found.is_noise and found.explained(part)[0] >= MACHINES.verdict.whole

    def is_imitation(self, found: "MachineFit") -> bool:
        """By the ratio of the change by effects one by one to that of all together."""
        return _cancellation(found) > MACHINES.search.most_cancellation

    def is_within_noise(self, found: "MachineFit") -> bool:
        """Never: what was learned as noise may be a small error of the model."""
        return False

    def share_of_gap(self, closure: float | None, share: float, p_remaining: float) -> float:
        """Without an absolute scale a gap may lie in the pulls of the base parameters alone."""
        return _share_by_rest(share, p_remaining) if closure is None else closure


class RowEvidence(Evidence):
    """The likelihood of all values, of runs that have few; their noise is known by replicates."""

    has_budget = False
    least_gain = MACHINES.steady.first_z**2

    def __init__(self, freedom: float) -> None:
        self.freedom = freedom

    def merit(self, found: "MachineFit") -> float:
        """Runs of few values are not left out."""
        return found.cost

    def charge(self, found: Fit, shapes: Sequence[ParameterKey]) -> float:
        """By the information on the shapes (Laplace)."""
        return found.shape_information(shapes) if shapes else 0.0

    def most_starts(self) -> int:
        """The best alone."""
        return 1

    def z(self, part: "MachineFit", found: "MachineFit", key: ParameterKey) -> float:
        """By the likelihood ratio; the size of the errors is uncertain."""
        gain = max(part.merit - found.merit, 0.0) / found.inflation
        known = math.isfinite(self.freedom)
        chance = float(stats.f.sf(gain, 1, self.freedom) if known else stats.chi2.sf(gain, 1))
        return -float(special.ndtri(max(0.5 * chance, 1e-300)))

    def needed(self, found: "MachineFit", share: float) -> tuple[float, float]:
        """More for each effect after the first."""
        if len(found.names) > 1:
            return MACHINES.steady.more_share, MACHINES.steady.more_z
        return MACHINES.search.share, MACHINES.steady.first_z

    def explained(self, part: "MachineFit", found: "MachineFit") -> tuple[float, float]:
        """By the cost above the number of values; no run is better or worse by itself."""
        excess_cost = max(part.cost - part.charge - part.count, 1e-9)
        share = float(np.clip((part.merit - found.merit) / excess_cost, -1.0, 1.0))
        return share, 1.0 if share > 0.0 else 0.0

    def explains_most(self, part: "MachineFit", found: "MachineFit") -> bool:
        """Predictions are dear, so pairs are left out where all values together are as near as noise.

        This is no reason to end the search: one more effect can be certain by itself.
        """
        return found.cost - found.charge <= _most_noise(found.count)

    def is_equal(self, one: "MachineFit", other: "MachineFit") -> bool:
        """By the likelihood ratio."""
        level, known = MACHINES.steady.set_level, math.isfinite(self.freedom)
        reach = float(stats.f.ppf(level, 1, self.freedom) if known else stats.chi2.ppf(level, 1))
        return abs(one.merit - other.merit) <= other.inflation * reach

    def gains_alike(self, gain: float, best: float) -> bool:
        """Values that count one by one have one rule only, `is_equal`."""
        return True

    def is_within_noise(self, found: "MachineFit") -> bool:
        """Never asked of left-out runs."""
        return False

    def determined(self, card: EffectCard) -> tuple[Parameter, ...]:
        """The strength: steady experiments seldom determine a shape; a share of 0 or 1 is possible."""
        return card.parameters[:1]

    def half_width(self, found: "MachineFit", index: int) -> float:
        """By all values, wider where they are farther off than their errors."""
        known = math.isfinite(self.freedom)
        far = float(stats.t.ppf(0.975, self.freedom) if known else stats.norm.ppf(0.975))
        return far * math.sqrt(found.inflation) * float(found.left_out.by_samples[index])

    def misfit_p(self, found: "MachineFit", structure: Callable[[], list[float]]) -> list[float]:
        """The lack of fit against replicates, in total or in any channel.

        Under its priors the sum of squares of residuals and pulls has as many degrees of freedom as there are
        values.
        """
        channel = found.noise.channel
        squares, counts = np.bincount(channel, weights=found.errors**2), np.bincount(channel)
        total = self._ratio_p(found.cost - found.charge, found.count - len(found.names))
        each = [
            self._ratio_p(float(square), float(count))
            for square, count in zip(squares, counts, strict=True)
            if count
        ]
        return [min(1.0, 2.0 * min(total, len(each) * min(each)))]

    def _ratio_p(self, square: float, count: float) -> float:
        if math.isfinite(self.freedom):
            return float(stats.f.sf(square / count, count, self.freedom))
        return float(stats.chi2.sf(square, count))

    def is_contradicted(self, improved: float, closure: float | None, lean: tuple[float, float]) -> bool:
        """The errors lean towards the base model."""
        size, length = lean
        return size > max(MACHINES.steady.veto_sd, 0.5 * length)

    def share_of_gap(self, closure: float | None, share: float, p_remaining: float) -> float:
        """With few values a gap may lie in the pulls of the base parameters alone."""
        return _share_by_rest(share, p_remaining)


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineFit:
    """A machine with some effects, fitted to the output error.

    Attributes:
        names: The effects, sorted.
        fit: Parameters, residual and derivatives.
        noise: Size of the errors that the fit assumed.
        declared_sd: Declared noise by channel.
        left_out: Leave-one-run-out results.
        evidence: What it is compared by.
        charge: For free shapes, in minus two log-likelihood (Laplace).
    """

    names: Names
    fit: Fit
    noise: SensorNoise
    declared_sd: Array
    left_out: LeftOut
    evidence: Evidence
    charge: float = 0.0

    @property
    def decorrelated(self) -> "MachineFit":
        """The same for scores: errors, and what parameters change, without what the errors before say."""
        noise = replace(self.noise, neighbours=self.evidence.neighbours)
        change = noise.decorrelated
        fit = replace(self.fit, residual=change(self.fit.residual), jacobian=self.fit.jacobian.mapped(change))
        return replace(self, noise=noise, fit=fit)

    @property
    def cost(self) -> float:
        """Minus two log-posterior by the declared noise."""
        return float(self.errors @ self.errors + self.fit.pull @ self.fit.pull) + self.charge

    @property
    def pulls(self) -> float:
        """Cost of base parameters away from nominal."""
        base = [item.key.is_base for item in self.fit.free]
        return float(np.sum(self.fit.pull[np.array(base, dtype=np.bool_)] ** 2))

    @property
    def count(self) -> float:
        """Number of values."""
        return float(self.left_out.counts.sum())

    @property
    def inflation(self) -> float:
        """Ratio of the remaining cost to that of errors alone, at least 1."""
        return max(1.0, (self.cost - self.charge) / max(self.count - len(self.names), 1.0))

    @property
    def errors(self) -> Array:
        """Measured minus simulated, in units of the declared noise."""
        return in_declared_units(self.fit, self.noise, self.declared_sd)

    @property
    def error(self) -> float:
        """Sum of squared errors of runs predicted by the others, in units of the declared noise."""
        return float(self.left_out.squares.sum())

    @property
    def merit(self) -> float:
        """What speaks against it, in minus two log-likelihood; smaller is better."""
        return self.evidence.merit(self)

    @property
    def excess(self) -> float:
        """The part of it that the declared noise does not explain; positive."""
        return max(self.error - float(self.left_out.counts.sum()), 1e-9)

    @property
    def is_noise(self) -> bool:
        """True where errors of left-out runs are no larger than the noise that the fit is compared with."""
        return self.error <= _most_noise(self.count)

    @property
    def is_within_noise(self) -> bool:
        """True where the declared noise of the sensors explains what is left of left-out runs."""
        return self.evidence.is_within_noise(self)

    def explained(self, part: "MachineFit") -> tuple[float, float]:
        """Return the explained share of the excess error of a smaller fit, and that of better runs."""
        return self.evidence.explained(part, self)

    def is_equal(self, other: "MachineFit") -> bool:
        """Return True where the runs find this neither clearly worse than the other nor better."""
        return self.evidence.is_equal(self, other)


def _cancellation(found: MachineFit) -> float:
    """Return the ratio of the change by effects one by one to that of all together, at least 1.

    Large effects that nearly cancel imitate another effect by their small difference.
    """
    first: dict[str, int] = {}
    for place, item in enumerate(found.fit.free):
        if item.key.is_of_effect:
            first.setdefault(item.key.effect, place)
    places = list(first.values())
    changes = found.fit.jacobian.columns(places) * found.fit.pull[places]
    together = float(np.linalg.norm(changes.sum(axis=1)))
    return float(np.linalg.norm(changes, axis=0).sum()) / max(together, 1e-300)


def _share_by_rest(share: float, p_remaining: float) -> float:
    return 1.0 if p_remaining > MACHINES.tests.alpha else share


def _most_noise(count: float) -> float:
    """Return the greatest sum of squares that counts as noise."""
    return count * (1.0 + 3.0 * math.sqrt(2.0 / count))


def in_declared_units(fit: Fit, noise: SensorNoise, declared_sd: Array) -> Array:
    """Return measured minus simulated of a fit in units of the declared noise of each channel."""
    errors: Array = fit.residual * (noise.channel_sd / declared_sd)[noise.channel]
    return errors
