"""Values that a prediction leaves open: base parameters and effects at their nominal values."""

from collections.abc import Mapping, Sequence

from sim_backends.models.interface import EffectCard, Parameter, Values


class NominalValues:
    """Fills in nominal values of base parameters and effects."""

    def __init__(self, parameters: Sequence[Parameter], effects: Sequence[EffectCard]) -> None:
        self._base = {item.name: item.nominal for item in parameters}
        self._effects = {card.name: {item.name: item.nominal for item in card.parameters} for card in effects}

    def fill(
        self, parameters: Values, effects: Mapping[str, Values]
    ) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
        """Return the values of all base parameters, and of all parameters of all effects."""
        base = {**self._base, **parameters}
        return base, {name: {**null, **effects.get(name, {})} for name, null in self._effects.items()}
