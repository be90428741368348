"""The model-gap workflow: where model and measurement disagree, and which effect is missing.

A model of your own imports what it needs from here; see docs/tutorials/gap.md.
"""

from sim_backends.models.interface import (
    Array,
    Channel,
    DrivenModel,
    EffectCard,
    Model,
    Parameter,
    Port,
    Run,
    RunParameter,
    RunReader,
    StretchReader,
    Values,
    parameter,
)
from sim_backends.models.nominal_values import NominalValues
from sim_backends.state_model import effects
from sim_backends.state_model.model import StateModel

__all__ = [
    "Array",
    "Channel",
    "DrivenModel",
    "EffectCard",
    "Model",
    "NominalValues",
    "Parameter",
    "Port",
    "Run",
    "RunParameter",
    "RunReader",
    "StateModel",
    "StretchReader",
    "Values",
    "effects",
    "parameter",
]
