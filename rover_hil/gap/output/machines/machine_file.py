"""Model file of a machine."""

from rover_hil.gap.base_parameters import HALF_WIDTHS
from rover_hil.gap.machines.analysis import MachineFindings
from rover_hil.gap.machines.evidence.sizes import size_of
from rover_hil.gap.output.model_file import ModelFile, Provenance, describe_model
from sim_backends.models.interface import Model


def describe_machine(findings: MachineFindings, model: Model, base: str, provenance: Provenance) -> ModelFile:
    """Return the model file with the effects that were named; the unknowns of single runs are left out.

    The standard deviation of each number is that of a normal with the interval of the verdict, so that it
    covers the scatter between runs.

    Args:
        findings: Their explanation has at least one effect.
        model: The model that was analysed; may be an extended one.
        base: Name on the command line.
        provenance: Origin of the numbers.
    """
    fitted = findings.best.fit
    sizes = {item.key: size_of(findings.best, item.key) for item in fitted.free if not item.key.run}
    intervals = {key: (one.low, one.high) for key, one in sizes.items()}
    deviations = {
        key: max(one.high - one.value, one.value - one.low) / HALF_WIDTHS for key, one in sizes.items()
    }
    return describe_model(model, base, provenance, fitted, intervals, deviations)
