"""The proposed run as a table: its inputs over time, and what each explanation predicts."""

import csv
import io

import numpy as np

from rover_hil.gap.next_run.proposal import Proposal
from rover_hil.gap.output.force_figures import NORMAL_95
from sim_backends.models.interface import Array, Channel

NEXT_RUN_NAME = "next_run.csv"


def next_run_text(proposal: Proposal) -> str:
    """Return the best run as CSV: run, conditions, time, inputs, and the predictions with their bands.

    With columns of measured values, named like the channels, the file is data like that of the runs.
    """
    best, machine = proposal.options[0], proposal.hypotheses[0].machine
    units = {**machine.condition_units, **machine.inputs}
    columns: dict[str, Array] = {
        f"{name} [{units[name]}]": np.full(best.planned.times_s.size, value)
        for name, value in best.planned.run.conditions.items()
        if name in units
    }
    columns["time [s]"] = best.planned.times_s
    columns |= {f"{name} [{unit}]": best.planned.run.inputs[name] for name, unit in machine.inputs.items()}
    for channel in machine.channels:
        for index, one in enumerate(proposal.hypotheses):
            mean, half = predicted(proposal, index, channel)
            label = f"{channel.name} by {one.name}"
            columns[f"{label} [{channel.unit}]"] = mean
            columns[f"{label} low [{channel.unit}]"] = mean - half
            columns[f"{label} high [{channel.unit}]"] = mean + half
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["run", *columns])
    for row in zip(*columns.values(), strict=True):
        writer.writerow(["next", *("" if np.isnan(value) else f"{value:.6g}" for value in row)])
    return stream.getvalue()


def predicted(proposal: Proposal, index: int, channel: Channel) -> tuple[Array, Array]:
    """Return what an explanation predicts of a channel in the best run, and half of its 95 % band."""
    best = proposal.options[0]
    measured = best.planned.run.measured
    names = [one.name for one in proposal.hypotheses[0].machine.channels if one.name in measured]
    if channel.name not in names:
        nothing = np.full(best.planned.times_s.size, np.nan)
        return nothing, nothing
    first = sum(measured[name].size for name in names[: names.index(channel.name)])
    here = slice(first, first + measured[channel.name].size)
    one = best.predictions[index]
    return one.mean_rows[here], NORMAL_95 * one.sd_rows[here]
