"""Parts that the models have in common."""

from types import SimpleNamespace

from rover_hil.gap import Array, Channel, Parameter, Run, RunParameter
from tests.nature.machines.case import Case


def constant(name: str, unit: str, nominal: float, spread: float, scatter: float) -> Parameter:
    """Return a positive parameter of a data sheet; `spread` and `scatter` are shares of `nominal`."""
    return Parameter(
        name=name,
        unit=unit,
        nominal=nominal,
        prior_sd=nominal * spread,
        scatter_sd=nominal * scatter,
        lower=0.1 * nominal,
        upper=10.0 * nominal,
    )


def start_error(state: str, unit: str, sd: float) -> RunParameter:
    """Return the difference between the true start of a state and the condition of the run."""
    return RunParameter(name=f"{state}_start_error", unit=unit, prior_sd=sd)


def begin(p: SimpleNamespace, state: str) -> Array:
    """Return the start of a state: the condition of the run and, where there is one, its error."""
    start: Array = getattr(p, f"start_{state}") + getattr(p, f"{state}_start_error", 0.0)
    return start


def channel(name: str, unit: str, sigma: float, quantum: float) -> Channel:
    """Return a channel given as a row of a data sheet."""
    return Channel(name=name, unit=unit, sigma=sigma, quantum=quantum)


def to_runs(case: Case) -> list[Run]:
    """Return the records of a case as runs: what the experimenter set and what was measured."""
    return [
        Run(
            name=run.name,
            conditions={name: value for name, value in run.conditions.items() if name.startswith("start_")},
            inputs=dict(run.inputs),
            measured=dict(run.measured),
        )
        for run in case.runs
    ]
