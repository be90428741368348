"""Every tuned number of reading, checking and splitting the data of `gap`.

Provenance, unless a line states another: chosen by hand, no record of the data. Units are in the names; other
numbers are ratios. A result's sensitivity to each number is printed by
`python -m benchmarks.sensitivity data`.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckParameters:
    """Measurements that cannot be used."""

    missing_share: float = 0.05  # of the values of a series, at most
    contradiction_sd: float = 15.0  # spread of replicates, in their usual scatter, that contradicts
    # Of the variance between replicates, over all, from which nothing is reproducible.
    irreproducible_share: float = 0.7
    least_groups: int = 3  # of replicates, to judge scatter
    least_slow_samples: int = 10  # of a channel that is slower than its inputs
    regular_share: float = 0.9  # of the steps between its values, that differ by a sample at most


@dataclass(frozen=True, slots=True, kw_only=True)
class RunParameters:
    """Least amount of data."""

    least_steady: int = 6  # runs of a steady model that can be split
    least_series: int = 4  # runs of series that can be split
    least_samples: int = 30  # of a series
    least_rows: int = 30  # of a log
    least_units: int = 3  # units under test that are left out one by one; with fewer, runs are
    # Greatest difference of times from even ones, and of steps from those of the model, over a step.
    step_share: float = 0.01
    # Samples in a row that a recorder may have dropped: inputs between are held or interpolated, not known.
    most_dropped: int = 3
    # Of an error at the start while the time since then doubles: that of a position by a constant jerk. What
    # grows more, grows exponentially.
    most_growth: float = 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanParameters:
    """Runs that are locked for the validation."""

    locked_share: float = 0.25  # of the runs
    few_levels: int = 8  # of a condition with no more, each level stays in the open runs
    least_groups: int = 8  # of conditions, to lock whole ones


@dataclass(frozen=True, slots=True, kw_only=True)
class PriorParameters:
    """Priors and steps of derivatives, in prior standard deviations."""

    weak: float = 10.0  # prior of the strength of an effect, in its natural sizes: too wide to bias it
    step_share: float = 0.05  # step of derivatives by base parameters
    effect_step_share: float = 0.2  # step of derivatives by effects


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowParameters:
    """Measured drives are averaged over windows, and cut into stretches."""

    window_s: float = 0.2
    least_duration_s: float = 3.0  # of a drive
    slowest_pose_s: float = 0.5  # between two poses of a drive; slower ones do not show turns
    # Accuracy that the force balance of a rover claims. Noise of this size is added to its measured motion:
    # in the exact poses of a simulation a hundredth of it, from averages over windows, would count as a gap.
    balance_m_s: float = 0.001
    balance_rad_s: float = 0.002
    most: int = 400  # windows of a drive
    least: int = 30  # windows of a drive
    least_stretch: int = 64  # windows of a stretch
    least_stretches: int = 4  # of a drive that is cut


@dataclass(frozen=True, slots=True, kw_only=True)
class ReaderParameters:
    """Readers of measured drives."""

    # Over which tilt is smoothed: noise in an input makes effects that depend on it look smaller.
    tilt_windows: int = 5
    # Rms difference of the speeds of both sides, over their mean; below it there are no turns.
    least_difference: float = 0.02
    current_windows: int = 5  # over which currents are smoothed
    direction_step_deg: float = 5.0  # directions of travel are replicates within this step
    least_points: int = 12  # of a drive on a side slope


@dataclass(frozen=True, slots=True, kw_only=True)
class DataParameters:
    """All tuned numbers, by their part of the workflow."""

    checks: CheckParameters = CheckParameters()
    runs: RunParameters = RunParameters()
    plan: PlanParameters = PlanParameters()
    fit: PriorParameters = PriorParameters()
    windows: WindowParameters = WindowParameters()
    readers: ReaderParameters = ReaderParameters()


DATA = DataParameters()
