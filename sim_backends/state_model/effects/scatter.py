"""Effects whose strength differs between runs or units under test."""

from collections.abc import Mapping
from dataclasses import replace

from sim_backends.models.interface import EffectCard
from sim_backends.models.ranges import require_not_negative
from sim_backends.state_model.port_effect import PortEffect


def scattering(effect: PortEffect, *, sd: float, by: str = "") -> PortEffect:
    """Return an effect whose strength differs between runs, or between units under test.

    Signal: that of the effect. Not for `delay`, `lag`, `play` and `wrong_parameter`.

    The units share one prior: their mean and their common standard deviation. So does a unit that is measured
    for the first time.

    Args:
        effect: Any effect but a delay, a lag, a play or a wrong parameter.
        sd: Standard deviation between units, in the unit of the strength.
        by: Condition with the number of the unit under test; without it, each run is separate.
    """
    require_not_negative(f"scattering effect at {effect.port}", sd=sd)

    def build(units: Mapping[str, str]) -> EffectCard:
        card = effect.build(units)
        first = replace(card.parameters[0], scatter_sd=sd, scatter_by=by)
        return replace(card, parameters=(first, *card.parameters[1:]))

    return replace(effect, build=build)
