"""Every tuned number of naming and validating effects, for tables and series.

Provenance, unless a line states another: chosen by hand, not fitted, no record of a comparison. Development
cases are those from 10000 on of the side slope (`benchmarks/gap/cases.py`). Units are in the names; other
numbers are ratios. A result's sensitivity to each number is printed by
`python -m benchmarks.gap.parameter_sensitivity --of explain`.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class GapParameters:
    """Test of the gap. Weights share the probability of error (weighted Bonferroni)."""

    alpha: float = 0.01  # probability of a gap without one, a promise to users
    effects_weight: float = 2.0  # of the scores of effects
    free_weight: float = 1.0  # of the scores of free terms
    fit_weight: float = 1.0  # of the lack of fit


@dataclass(frozen=True, slots=True, kw_only=True)
class PrepareParameters:
    """Noise and base fit."""

    condition_step: float = 0.01  # step of derivatives by a condition, over its range
    unsolved_share: float = 0.2  # of the runs without a solution, above which the data are refused
    # Least score of an effect that is removed from the residual before errors are estimated.
    stands_out: float = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateParameters:
    """Effects that the data can show."""

    # Least share of the change by an effect that base parameters do not absorb; below, derivatives are too
    # inexact.
    visible: float = 1e-3
    exact: float = 1e-6  # the same for series, whose models are explicit formulas
    shown: float = 1.0  # least strength of an effect of natural size, in standard errors


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchParameters:
    """Fits of one or several effects."""

    starts: int = 2  # starting shapes of a fit
    far: tuple[float, float, float, float] = (0.5, 1.0, 2.0, 4.0)  # strengths to start from, in natural sizes
    # Strong effects to start from: for a delay, the nearest in cost may be another local minimum.
    far_starts: int = 3
    most_cancellation: float = 4.0  # greatest ratio of the effects one by one to their sum
    hopeless: float = 60.0  # cost above the best at which a fit ends early
    at_limit: float = 1e-3  # share of its range within which a strength is at its limit


@dataclass(frozen=True, slots=True, kw_only=True)
class NamingParameters:
    """Which effects are named."""

    alpha: float = 0.005  # family-wise probability of a first name without gap, a promise to users
    more_alpha: float = 0.005  # the same for each further name
    # Of the likelihood ratio for one alternative in the set; for all of them it stays above 95 %.
    set_level: float = 0.99
    most_effects: int = 3  # named together
    top: int = 8  # effects by score, of which sets are formed
    # Share not absorbed by base parameters below which an insignificant effect counts as imitated.
    imitated: float = 0.1
    share_of_rest: float = 0.5  # of the remaining cost, that a further effect must explain
    # Of the gain of the best, that an alternative beyond sample errors must reach; raised from 0.5 for series
    # whose runs scatter.
    share_of_best: float = 0.9
    tried_per_size: int = 8  # sets of one size to fit: half by first order, half by the best smaller ones
    alike: float = 0.9  # least cosine of two effects that are not fitted together
    worth: float = 0.6  # share of the significant gain from which on larger sets are fitted


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationParameters:
    """Locked runs."""

    widening: float = 3.0  # of the prior of base parameters, for the validation
    placebos: int = 20  # random smooth terms, fitted like an effect
    resamples: int = 1000  # of the locked runs
    harm: float = 1.02  # error after the correction, over that before, that is worse
    # Greatest tendency of the errors on the locked runs towards the base model, in standard deviations.
    veto_sd: float = 3.0
    # Least excess of the error of a channel over the noise for a closure, in standard errors.
    clear: float = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LocaliseParameters:
    """Where the residual is."""

    alpha: float = 0.01
    most_levels: int = 8  # of a condition; of one with more, quartiles are the levels
    most_places: int = 6  # that are reported


@dataclass(frozen=True, slots=True, kw_only=True)
class EquationParameters:
    """Equations of a residual without a name."""

    top_terms: int = 12  # by score
    most_terms: int = 3  # of an equation
    most: int = 3  # equations
    most_sources: int = 6  # of terms


@dataclass(frozen=True, slots=True, kw_only=True)
class NextRunParameters:
    """The run that would separate the alternatives."""

    most_levels: int = 5  # of a condition that are tried
    clear_sd: float = 3.0  # distance of two alternatives that separates them
    most_repetitions: int = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictParameters:
    """Rules of the verdict."""

    whole_share: float = 0.9  # of the explainable gap, for a name without reservation
    whole_share_of_series: float = 0.98  # the same for series, whose many samples show more of an effect
    half_share: float = 0.5  # of the explainable gap, for a name
    most_members: int = 4  # of a set of alternatives
    power_z: float = 1.28  # standard normal quantile of 90 % power


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainParameters:
    """All tuned numbers, by their part of the workflow."""

    gap: GapParameters = GapParameters()
    prepare: PrepareParameters = PrepareParameters()
    candidates: CandidateParameters = CandidateParameters()
    search: SearchParameters = SearchParameters()
    naming: NamingParameters = NamingParameters()
    validation: ValidationParameters = ValidationParameters()
    localise: LocaliseParameters = LocaliseParameters()
    equations: EquationParameters = EquationParameters()
    next_run: NextRunParameters = NextRunParameters()
    verdict: VerdictParameters = VerdictParameters()


EXPLAIN = ExplainParameters()
