"""Write tuned values into the text of a configuration; its comments and order stay."""

from rover_hil.config.entry import with_entry
from rover_hil.config.tune_settings import ProvenanceRecord
from rover_hil.tune.parameters import Values


def tuned_text(text: str, values: Values, provenance: ProvenanceRecord | None) -> str:
    """Return the text of a configuration with new values and their provenance.

    Args:
        text: A valid configuration.
        values: By dotted key.
        provenance: Replaces that of an earlier tuning; None leaves it as it is.
    """
    for dotted_key, value in values.items():
        section, _, key = dotted_key.rpartition(".")
        text = with_entry(text, section, key, value)
    if provenance is None:
        return text
    return with_entry(text, "tune", "provenance", provenance.model_dump(mode="json", exclude_none=True))
