"""Measured and simulated series of a machine's runs, in the form that the pictures need."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.gap.data.problem import Problem, split_point
from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.search.tracking import force_series
from sim_backends.models.interface import Array, Channel, Machine
from sim_backends.state_model.model import StateModel
from sim_backends.state_model.sample_times import sample_times_s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trace:
    """One channel of one run.

    Attributes:
        run: Name of the run.
        channel: The channel.
        is_locked: The run was used for the validation only.
        times_s: Since the start of the run.
        measured: Values; NaN where missing.
        before: Simulated by the base model, fitted; NaN where missing in a locked run.
        after: The same with the effects; None without effects.
    """

    run: str
    channel: Channel
    is_locked: bool
    times_s: Array
    measured: Array
    before: Array
    after: Array | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForceTrace:
    """The unknown force at one port in one run, at its knots.

    Attributes:
        run: Name of the run.
        port: Name of the port.
        unit: Of the force.
        times_s: Of the knots, since the start of the run.
        force: Most probable force.
        sd: Standard deviation of it.
        sources: States and inputs at the knots, of the machine that follows the run.
    """

    run: str
    port: str
    unit: str
    times_s: Array
    force: Array
    sd: Array
    sources: dict[str, Array]


def traces(findings: MachineFindings) -> list[Trace]:
    """Return every channel of every run that was used, locked runs last."""
    problem, has_effects = findings.problem, bool(findings.best.names)
    points = [findings.base.fit.point, findings.best.fit.point]
    residuals = [problem.observations.values - problem.predict(point) for point in points]
    found = _traces_of(findings.machine, problem, residuals, has_effects=has_effects, is_locked=False)
    if findings.holdout is not None:
        locked = findings.holdout
        found += _traces_of(
            findings.machine, locked.problem, locked.residuals, has_effects=has_effects, is_locked=True
        )
    return found


def _traces_of(
    machine: Machine, problem: Problem, residuals: Sequence[Array], *, has_effects: bool, is_locked: bool
) -> list[Trace]:
    observations = problem.observations
    found = []
    for site, run in enumerate(problem.sites):
        for index, channel in enumerate(observations.channels):
            rows = (observations.site == site) & (observations.channel == index)
            if not rows.any():
                continue
            measured = observations.values[rows]
            before, after = (measured - residual[rows] for residual in residuals)
            found.append(
                Trace(
                    run=run.name,
                    channel=channel,
                    is_locked=is_locked,
                    times_s=sample_times_s(run, machine.step_s),
                    measured=measured,
                    before=before,
                    after=after if has_effects else None,
                )
            )
    return found


def trajectories(findings: MachineFindings) -> list[dict[str, Array]]:
    """Return states and inputs of each run of the search; on the measured trajectory where there is one."""
    machine, point = findings.machine, findings.base.fit.point
    tracked = findings.tracked
    if tracked is not None and isinstance(tracked.problem.model, StateModel):
        machine, point = tracked.problem.model, tracked.point
    return machine.trajectories(findings.problem.sites, *split_point(point))


def forces(findings: MachineFindings) -> list[ForceTrace]:
    """Return the unknown force at every port in every run; nothing where there is no gap."""
    tracked, machine = findings.tracked, findings.machine
    if tracked is None or not isinstance(machine, StateModel):
        return []
    basis = tracked.noise.basis
    series = trajectories(findings)
    found = []
    for site, run in enumerate(findings.problem.sites):
        times_s = sample_times_s(run, machine.step_s)
        knots = np.arange(basis.knots) * basis.spacing
        knots = knots[knots <= times_s.size - 1]
        samples = np.arange(times_s.size)
        deviation = np.sqrt(np.maximum(np.diag(tracked.covariances[site]), 0.0))
        by_port = deviation.reshape(len(basis.ports), basis.knots)
        values = force_series(basis, tracked.forces[site])
        for index, port in enumerate(machine.ports):
            force = values[port.name]
            found.append(
                ForceTrace(
                    run=run.name,
                    port=port.name,
                    unit=port.unit,
                    times_s=np.interp(knots, samples, times_s),
                    force=np.interp(knots, np.arange(force.size), force),
                    sd=basis.scales[index] * by_port[index, : knots.size],
                    sources={name: np.interp(knots, samples, one) for name, one in series[site].items()},
                )
            )
    return found
