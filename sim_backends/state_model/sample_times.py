"""Times of the samples of a run: from the step of the model, or from the data, evenly spaced or not."""

import numpy as np

from drivers.errors import ConfigError
from sim_backends.models.interface import Array, Run

EVEN_SHARE = 0.01
"""Differences of steps, over a step, that are rounding of the times."""


def sample_times_s(run: Run, step_s: float | None) -> Array:
    """Return the times of the samples of a run since its start.

    Args:
        run: With an input `t_s` where no step is given.
        step_s: Time between samples; None where the run has its own times.

    Raises:
        ConfigError: The times of the run do not increase.
    """
    if step_s is None and run.inputs["t_s"].size > 1:
        times_s = run.inputs["t_s"]
        steps = np.diff(times_s)
        if not steps.min() > 0.0:
            raise ConfigError(
                f"run {run.name}: the time does not increase after {times_s[int(np.argmin(steps))]:g} s"
            )
        step_s = float(np.round(np.median(steps), 12))
        if float(np.abs(steps - step_s).max()) > EVEN_SHARE * step_s:
            uneven: Array = times_s - times_s[0]
            return uneven
    even: Array = (step_s or 1.0) * np.arange(run.count, dtype=np.float64)
    return even


def mean_step_s(run: Run, step_s: float | None) -> float:
    """Return the mean time between samples of a run; see `sample_times_s`."""
    times_s = sample_times_s(run, step_s)
    return float(np.round(times_s[-1] / max(times_s.size - 1, 1), 12))


def even_step_s(run: Run, step_s: float | None) -> float:
    """Return the time between samples of a run for a simulator that knows no other.

    Raises:
        ConfigError: The times of the run are not evenly spaced.
    """
    mean_s, steps = mean_step_s(run, step_s), np.diff(sample_times_s(run, step_s))
    if float(np.abs(steps - mean_s).max()) > EVEN_SHARE * mean_s:
        raise ConfigError(
            f"run {run.name}: samples are {steps.min():.4g} to {steps.max():.4g} s apart, and the unit is "
            "simulated in equal steps: interpolate the record to equal steps"
        )
    return mean_s
