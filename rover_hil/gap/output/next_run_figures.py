"""Picture of the proposed run: its inputs, and what each explanation predicts."""

from matplotlib.figure import Figure

from rover_hil.gap.next_run.proposal import Proposal
from rover_hil.gap.output.figures import MANY, WIDTH_IN
from rover_hil.gap.output.next_run_file import predicted
from rover_hil.pages import style
from sim_backends.models.interface import Channel

COLOURS = (style.ESTIMATE, style.ENCODERS, style.GYRO, style.ALARM, style.TRUTH, style.COMMANDED)
MOST_INPUTS = 3
"""That a drawing shows."""


def draw_next_run(proposal: Proposal, channel: Channel) -> Figure:
    """Draw the predictions of a channel with their 95 % bands, and the inputs below."""
    planned, machine = proposal.options[0].planned, proposal.hypotheses[0].machine
    inputs = list(machine.inputs)[:MOST_INPUTS]
    figure = Figure(figsize=(WIDTH_IN, 2.9 + 0.8 * len(inputs)), layout="constrained")
    heights = (3.0, *(1.0 for _ in inputs))
    rows = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    times_s = planned.times_s
    for index, one in reversed(list(enumerate(proposal.hypotheses))):
        colour = style.COMMANDED if one.is_else else COLOURS[index]
        mean, half = predicted(proposal, index, channel)
        rows[0].fill_between(times_s, mean - half, mean + half, color=colour, alpha=0.25, linewidth=0)
        rows[0].plot(
            times_s, mean, color=colour, linewidth=1.3, label=one.name, rasterized=times_s.size > MANY
        )
    rows[0].set_title(f"{channel.name}, next run")
    rows[0].set_ylabel(_label(channel.name, channel.unit))
    for axes, name in zip(rows[1:], inputs, strict=True):
        axes.plot(times_s, planned.run.inputs[name], color=style.TRUTH, linewidth=1.0)
        axes.set_ylabel(_label(name, machine.inputs[name]))
    rows[-1].set_xlabel("time (s)")
    handles, labels = rows[0].get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside lower center", ncols=1)
    return figure


def _label(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name}\n({unit})"
