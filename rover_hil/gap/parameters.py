"""Every tuned number of the judgement of machines.

Provenance, unless a line states another: chosen by hand, not fitted, no record of a comparison. Development
cases are those below 1000 of `tests/nature/machines`. Units are in the names; other numbers are ratios. A
result's sensitivity to each number is printed by
`python -m benchmarks.sensitivity machines`.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class DescentParameters:
    """Fit of many explanations in lockstep."""

    dampings: tuple[float, ...] = (0.0, 0.01, 0.1, 1.0, 10.0)
    # Tried where none of the others is better.
    small_dampings: tuple[float, ...] = (30.0, 300.0, 3000.0, 1e-3, 0.03)
    # Multiples of the last step that are tried, too: a narrow curved valley allows only short steps
    # otherwise.
    farther: tuple[float, float] = (3.0, 10.0)
    most_rounds: int = 25  # 15 until curved valleys were followed with longer steps
    # Gain of minus two log-likelihood below which a fit ends; raised from 0.02 for speed.
    converged: float = 0.1
    slow: float = 1e-3  # the same, per residual


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineFitParameters:
    """Starts and derivatives."""

    # Share of the information of a run that leaving it out removes; what only this run informs would else be
    # left to the priors alone, far outside the range of a linearisation.
    left_out: float = 0.9
    start_draws: int = 64  # starts of the unknowns of a run
    beginning: float = 0.25  # share of a run that its unknowns are started from
    start_shares: tuple[float] = (0.3,)  # strengths to start from besides none, in natural sizes
    # The same of models that can only be called, and how many of these starts are fitted.
    called_shares: tuple[float, ...] = (0.0, 0.3, -0.3, 0.5, -0.5, 1.0, -1.0, 2.0, -2.0, 4.0, -4.0)
    called_starts: int = 2
    # Step of derivatives by effects, over the usual one: an integration is exact to many digits.
    fine_step: float = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedNoiseParameters:
    """Noise that no sensor declares, learned from the runs."""

    # Greatest ratio of errors to their fast part, by which neighbouring samples differ, that is still noise:
    # an autoregression of 0.95 has 4.5, white noise 1.
    slow: float = 5.0
    # Least distance of a strength from its null where the noise is learned, instead of those of the search.
    z: float = 3.3


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyParameters:
    """Steady experiments: the errors are known by replicates, and a run has few values."""

    condition_step: float = 0.01  # step of derivatives by a condition, over its range
    unsolved_share: float = 0.2  # of the runs without a solution, above which the data are refused
    # Likelihood ratio of a first effect, and of each further one, as a standard normal.
    first_z: float = 2.7
    more_z: float = 3.3
    more_share: float = 0.5  # of the remaining error, that a further effect must explain
    set_level: float = 0.99  # of the likelihood ratio for one alternative in the set
    # Greatest tendency of the errors on the locked runs towards the base model, in standard deviations.
    veto_sd: float = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GapTestParameters:
    """Tests of the gap."""

    alpha: float = 0.01  # probability of a gap without one, a promise to users
    effects_weight: float = 2.0  # of the scores of effects beside those of free-form terms
    sigma_uncertainty: float = 0.1  # relative uncertainty of a declared sensor noise
    # Of the random force in the longest run: slow errors, and faster ones.
    knot_counts: tuple[int, int] = (8, 40)
    # Step of a sensor, in its noise, from which rounding is no independent error of each sample.
    coarse: float = 3.0
    # Of a channel with a wrong unit: least share of its variance that a multiple of the prediction explains.
    same_shape: float = 0.9
    # Least multiple: no number of a model is known worse, and degrees are 57 times radians.
    most_ratio: float = 20.0
    reached: float = 1e-3  # least relative response of a direction that a force reaches


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetParameters:
    """Model error of each channel."""

    # Default tolerance of a model error, in units of the noise of the sensor: an error as large as the noise
    # raises the error of one predicted reading by 41 %, and readings alone show no more; a smaller default
    # would call a sensor that is declared 40 % too good a gap.
    tolerance: float = 1.0
    level: float = 0.95  # of the bound of a model error


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineSearchParameters:
    """Search for the explanation."""

    # Least share of the remaining excess error that an effect must explain on runs it was not fitted to.
    share: float = 0.15
    agreeing_share: float = 0.7  # least share of the runs that an effect must improve
    # Least distance of a strength from its null over the scatter of runs, as a standard normal.
    least_z: float = 2.5
    clear_z: float = 1.9  # the same for an effect that explains `clear_share`
    clear_share: float = 0.5  # of the remaining excess error
    # Greatest ratio of the effects one by one to their sum, where the noise is learned.
    most_cancellation: float = 4.0
    singles: int = 10  # effects to fit in one step, the best to first order
    pairs: int = 15  # the same, of pairs
    most_effects: int = 6  # of an explanation
    most_rounds: int = 10  # of adding and removing
    twins: float = 0.9  # cosine from which two effects are alternatives of each other
    pair_top: int = 16  # effects by score, of which pairs are formed
    most_orders: int = 6  # explanations that are fitted with their effects in another order
    same: float = 0.98  # cosine from which two effects are not fitted together
    set_share: float = 0.9  # least share of the gain of the best explanation for an alternative
    set_level: float = 0.95  # of the test that an alternative is as good as the best
    at_limit: float = 1e-3  # share of its range within which a strength is at its limit


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeTermParameters:
    """Free terms for a law that is no effect."""

    most_fitted: int = 5  # the best to first order; 8 until fits were made faster
    threshold: float = 0.6  # place of a threshold, over the largest and the smallest value of its source
    same_law: float = 0.97  # cosine above which a term is the same law as an effect
    alike: float = 0.9  # the same, of a term at an output
    most_drafts: int = 3  # that are reported


@dataclass(frozen=True, slots=True, kw_only=True)
class LocaliseParameters:
    """Where the residual is."""

    alpha: float = 0.01
    most_levels: int = 8  # of a condition; of one with more, quartiles are the levels


@dataclass(frozen=True, slots=True, kw_only=True)
class EquationParameters:
    """Equations of a residual without a name."""

    top_terms: int = 12  # by score
    most_terms: int = 3  # of an equation
    most: int = 3  # equations
    most_sources: int = 6  # of terms


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingParameters:
    """Smoothing of a machine onto its runs."""

    rounds: int = 4
    halvings: int = 3  # of a step
    progress: float = 0.01  # relative gain below which the smoothing ends


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineVerdictParameters:
    """Rules of the verdict."""

    whole: float = 0.9  # least share of the gap, on locked runs, that a name without reservation closes
    half: float = 0.5  # least share that a name closes
    most_members: int = 4  # of a set of alternatives
    # Score of an effect by the noise of the samples that counts as detectable; a convention, not calibrated.
    power_z: float = 4.0
    resamples: int = 1000  # of the locked runs


@dataclass(frozen=True, slots=True, kw_only=True)
class DecideParameters:
    """The one decision: explanations compared over resampled units of observation."""

    draws: int = 2000  # Dirichlet weights of the units
    least_units: int = 6  # with fewer, nothing is named
    most_stretches: int = 12  # units that runs are cut into where there are fewer than six
    # Values that would know the size of the errors of one channel in one unit as well as its declared noise.
    size_freedom: float = 4.0
    named: float = 0.95  # least probability of a name
    partly: float = 0.8  # least probability of a name where something else remains
    whole_set: float = 0.95  # probability of a set
    most_sizes: float = 10.0  # greatest size of a name, in its declared size
    # Greatest structure in the errors that a name leaves, over the tolerance: a twenty-fifth of the variance
    # of the noise, if that is the tolerance.
    structure: float = 0.2
    shared_lags: int = 20  # distance of errors, in samples, up to which what they share is compared
    most_memory: float = 0.95  # greatest correlation of neighbouring errors that is slow noise of a sensor
    shared_sd: float = 3.0  # standard deviations of chance above which what errors share is structure
    # Orders whose predictions differ by less, in noises, are one: a tenth of the variance of the noise.
    same_order: float = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstAnswerParameters:
    """The answer before the search."""

    candidates: int = 3  # effects that are reported
    least_z: float = 3.0  # score below which an effect is not a candidate


@dataclass(frozen=True, slots=True, kw_only=True)
class RunScatterParameters:
    """Scatter between runs."""

    mentioned: int = 3  # parameters that are reported, those that matter most
    # Least share of the scatter, in squared changes of the predictions, for a parameter to be reported.
    notable: float = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class LinterParameters:
    """Check of a machine before it is used."""

    least_change: float = 1e-3  # greatest change of a prediction, in sensor noises, that counts as none
    similar: float = 0.9  # cosine above which inputs cannot separate two effects
    clear: float = 4.0  # standard errors from which an effect of natural size is found with 90 % probability
    # Where to try thresholds in the range of a signal.
    threshold_shares: tuple[float, ...] = (0.1, 0.3, 0.5, 0.7, 0.9)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialParameters:
    """Trial of a foreign model, and the time that an analysis will take."""

    integrations: int = 300  # of a usual analysis
    simulations: int = 25  # of each run in a usual analysis, for each parameter and each effect
    long_s: float = 1.0  # a run that takes no longer is not mentioned
    same_share: float = 0.1  # greatest difference of predictions that must be equal, over the sensor noise


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSourceParameters:
    """The signal that the error depends on."""

    bins: int = 10  # ranges of a source with equally many samples
    # Of the energy, that a source must explain, in each run that agrees and in all together.
    least_share: float = 0.25
    least_runs: int = 2  # that must agree
    simpler: float = 0.05  # share by which a source must exceed one that comes earlier


@dataclass(frozen=True, slots=True, kw_only=True)
class HypothesisParameters:
    """Explanations that the next run shall separate."""

    most: int = 5  # explanations
    # Effects to take as explanations where the search accepted none, the best to first order.
    top_scores: int = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedParameters:
    """Runs that could be made next."""

    # Factors on the inputs of a measured run.
    scales: tuple[float, ...] = (1.0, 0.25, 0.5, 0.75, 1.5, 2.0, 3.0, -1.0, -0.5)
    least_samples: int = 30  # of a planned run whose length is chosen
    most_samples: int = 4000  # the same
    step_at: float = 0.1  # share of the run before a step
    sines: int = 5  # of a mixture
    amplitude_shares: tuple[float, float, float] = (0.15, 0.4, 1.0)  # of what the limits leave
    periods_of_run: tuple[float, float] = (2.0, 8.0)  # periods in a run, to try where none are declared
    shortest_samples: float = 4.0  # shortest period of a shape


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionParameters:
    """The next steady experiment."""

    most_levels: int = 5  # of a condition that are tried
    clear_sd: float = 3.0  # distance of two explanations that separates them
    most_repetitions: int = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class DecisionParameters:
    """What the next run is expected to decide."""

    draws: int = 100  # simulated decisions for each explanation
    weights: int = 200  # Dirichlet weights of the runs in each simulated decision
    # Greatest probability that is stated: the list of explanations itself is uncertain.
    most_certain: float = 0.99
    most_blocks: int = 120  # means of neighbouring samples that are compared in a run, over all channels
    negligible: float = 2e-3  # size of a force, in its natural size, that is left out
    # Root mean square error, in sensor noises, that counts as noise in a channel without ports.
    noise_room: float = 1.05


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposalParameters:
    """Which runs are proposed."""

    # Changed runs whose decision is simulated; in addition to all repetitions of a measured one.
    most_simulated: int = 6
    # Probability of a right verdict, where the cause is in the list, that counts as separated.
    settled: float = 0.8
    repeats: tuple[int, int, int, int] = (2, 3, 5, 8)
    # Least rise of the probability of a right verdict by a run that is proposed.
    least_gain: float = 0.1
    # Distance of two explanations, in standard deviations, below which a run does not separate them.
    pair_apart: float = 2.0
    # Of a machine given by equations: runs planned, linearised, repeated.
    equations_effort: tuple[int, int, int] = (200, 30, 8)
    # The same of a unit, each of whose simulations costs its own time.
    unit_effort: tuple[int, int, int] = (40, 8, 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class MachinesParameters:
    """All tuned numbers, by their part of the workflow."""

    descent: DescentParameters = DescentParameters()
    fit: MachineFitParameters = MachineFitParameters()
    noise: LearnedNoiseParameters = LearnedNoiseParameters()
    steady: SteadyParameters = SteadyParameters()
    tests: GapTestParameters = GapTestParameters()
    budget: BudgetParameters = BudgetParameters()
    search: MachineSearchParameters = MachineSearchParameters()
    terms: FreeTermParameters = FreeTermParameters()
    localise: LocaliseParameters = LocaliseParameters()
    equations: EquationParameters = EquationParameters()
    tracking: TrackingParameters = TrackingParameters()
    verdict: MachineVerdictParameters = MachineVerdictParameters()
    decide: DecideParameters = DecideParameters()
    first: FirstAnswerParameters = FirstAnswerParameters()
    scatter: RunScatterParameters = RunScatterParameters()
    linter: LinterParameters = LinterParameters()
    trial: TrialParameters = TrialParameters()
    source: ErrorSourceParameters = ErrorSourceParameters()
    hypotheses: HypothesisParameters = HypothesisParameters()
    planned: PlannedParameters = PlannedParameters()
    conditions: ConditionParameters = ConditionParameters()
    decision: DecisionParameters = DecisionParameters()
    proposal: ProposalParameters = ProposalParameters()


MACHINES = MachinesParameters()
