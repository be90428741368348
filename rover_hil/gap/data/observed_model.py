"""A model restricted to what the runs hold: optional channels and alternative inputs."""

from collections.abc import Mapping, Sequence

import numpy as np

from sim_backends.models.interface import (
    Array,
    Channel,
    DrivenModel,
    EffectCard,
    EitherDriven,
    Model,
    Parameter,
    Run,
    Values,
)


class ObservedModel:
    """A model without the optional channels and the alternative inputs that its runs lack."""

    input_units: Mapping[str, str]

    def __init__(self, model: Model, runs: Sequence[Run]) -> None:
        self._model = model
        self.name: str = model.name
        self.channels: tuple[Channel, ...] = tuple(
            one
            for one in model.channels
            if not one.is_optional or any(one.name in run.measured for run in runs)
        )
        self.condition_units: Mapping[str, str] = model.condition_units
        self.parameters: tuple[Parameter, ...] = model.parameters
        self.effects: tuple[EffectCard, ...] = model.effects
        if isinstance(model, DrivenModel):
            unused = _unused(model, runs) if isinstance(model, EitherDriven) else ()
            self.input_units = {name: unit for name, unit in model.input_units.items() if name not in unused}

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict as the model; see `Model.predict`. A number becomes a series of one value."""
        found = self._model.predict(runs, parameters, effects)
        return [{name: np.atleast_1d(values) for name, values in table.items()} for table in found]


def _unused(model: EitherDriven, runs: Sequence[Run]) -> tuple[str, ...]:
    first, *others = model.alternative_inputs
    everywhere = [name for name in others if runs and all(name in run.inputs for run in runs)]
    used = everywhere[-1] if everywhere else first
    return tuple(name for name in model.alternative_inputs if name != used)
