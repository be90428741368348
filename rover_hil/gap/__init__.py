"""The model-gap workflow: where model and measurement disagree, and which effect is missing.

A model of your own imports what it needs from here; see docs/tutorials/gap_tutorial.md.
"""

from sim_backends.models.interface import (
    Array,
    Channel,
    DrivenModel,
    EffectCard,
    Model,
    Parameter,
    Run,
    RunReader,
    StretchReader,
    Values,
    parameter,
)
from sim_backends.models.nominal_values import NominalValues

__all__ = [
    "Array",
    "Channel",
    "DrivenModel",
    "EffectCard",
    "Model",
    "NominalValues",
    "Parameter",
    "Run",
    "RunReader",
    "StretchReader",
    "Values",
    "parameter",
]
