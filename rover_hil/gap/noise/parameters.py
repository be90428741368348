"""Every tuned number of the statistics of `gap`.

Provenance, unless a line states another: chosen by hand, not fitted, no record of a comparison. Development
cases are those from 10000 on of the side slope (`benchmarks/gap/cases.py`). Units are in the names; other
numbers are ratios. A result's sensitivity to each number is printed by
`python -m benchmarks.sensitivity statistics`.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class JackknifeParameters:
    """Scatter of a parameter from run to run."""

    least_runs: int = 6  # to leave out whole runs; below, stretches of them are left out
    # Weight of the prior, in runs, that runs scatter no more than their samples; without it, an effect in one
    # or two runs is never significant.
    agreeing_runs: float = 3.0
    beyond_chance: float = 0.9  # level of a test that runs scatter more than their samples
    scattering_runs: float = 1.0  # weight of the prior, in runs, if they do


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseParameters:
    """Errors of the measurements."""

    least_blocks: int = 24  # independent stretches of all runs together


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceParameters:
    """Random force at the ports of a machine."""

    knots: int = 40  # in the longest run
    samples_per_knot: int = 4  # at least
    # Correlation times to choose from, in distances of knots.
    lengths: tuple[float, float, float, float] = (1.0, 3.0, 10.0, 40.0)
    # Factors on the declared noise of all sensors to choose from.
    excess: tuple[float, ...] = (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0)
    sweeps: int = 3  # of the search
    flat: float = 1e-4  # least relative size of a direction that the force reaches


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplicateParameters:
    """Scatter of replicates of one condition."""

    clip_sd: float = 4.0  # from the median of the replicates; values further off are moved there
    many: float = 5.0  # differences between replicates, per variance, to estimate errors of settings
    least_freedom: int = 3  # replicates beyond the first, over all groups, to estimate a scatter


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreParameters:
    """Scores of effects and terms."""

    draws: int = 4000  # random draws of a family of scores
    # Least share of the scatter of samples for a term to count although runs disagree on it.
    large: float = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class StatisticsParameters:
    """All tuned numbers, by their part of the workflow."""

    jackknife: JackknifeParameters = JackknifeParameters()
    noise: NoiseParameters = NoiseParameters()
    force: ForceParameters = ForceParameters()
    replicates: ReplicateParameters = ReplicateParameters()
    score: ScoreParameters = ScoreParameters()


STATISTICS = StatisticsParameters()
