"""The answer on a machine in words: headline, one sentence, and what to do next."""

from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.evidence.error_budget import ChannelError
from rover_hil.gap.output.draft_file import DRAFT_NAME
from rover_hil.gap.verdict import Answer, Verdict


def lead(findings: MachineFindings) -> str:
    """Return the errors of the worst channel in one sentence."""
    pairs = list(zip(findings.budget_before, findings.budget_after, strict=True))
    before, after = max(pairs, key=lambda pair: pair[0].model_error / pair[0].tolerance)
    if findings.found is None:
        worst = max(findings.budget_before, key=lambda one: one.upper / one.tolerance)
        return (
            f"The model error of {worst.channel} is at most {_size(worst.upper, worst)}; "
            f"the tolerance is {_size(worst.tolerance, worst)}."
        )
    times = before.model_error / before.sensor_noise
    text = (
        f"The model error of {before.channel} is {_size(before.model_error, before)}, {times:.2g} times the "
        "sensor noise"
    )
    if findings.best.names:
        text += f"; with {' and '.join(findings.best.names)} it is {_size(after.model_error, after)}"
    if all(one.is_good_enough for one in findings.budget_before):
        text += f": more than chance, but less than the tolerance of {_size(before.tolerance, before)}"
    return f"{text}."


def _size(value: float, of: ChannelError) -> str:
    return f"{value:.3g}" if of.unit == "1" else f"{value:.3g} {of.unit}"


def next_steps(findings: MachineFindings, verdict: Verdict) -> list[str]:
    """Return what to do next, in sentences."""
    steps = [f"Next run: {verdict.next_run}."] if verdict.next_run else []
    experiments = {card.name: card.experiment for card in findings.machine.effects if card.experiment}
    if verdict.effects:
        steps.append(
            "Analyse new runs with the effect in the model: add --model model.toml to the command. "
            "The answer must be NO_GAP."
        )
    if len(verdict.confidence_set) > 1:
        names = dict.fromkeys(name for names in verdict.confidence_set for name in names)
        steps += [f"To single out {name}: {experiments[name]}." for name in names if name in experiments]
    if verdict.draft:
        steps.append(
            f"Add a line of {DRAFT_NAME} to the port_effects of the model and analyse again. Accept it only "
            "if you know the physics behind it."
        )
    if not verdict.effects and not verdict.draft:
        steps += _without_names(findings, verdict)
    return steps


def _without_names(findings: MachineFindings, verdict: Verdict) -> list[str]:
    if verdict.verdict is Answer.NO_GAP:
        return ["Nothing is to be done. The answer holds for inputs like those of these runs."]
    if findings.found is None:
        return [
            "Measure more or longer runs: the bound of the model error falls with their number. Or declare "
            "the `tolerance` of the channel that you need."
        ]
    if findings.tracked is None:
        return ["Look at what the error follows below: add an effect of the model that acts there."]
    return [
        "Look at the unknown force below: add an effect that acts where it is large, or a port where none is "
        "declared."
    ]
