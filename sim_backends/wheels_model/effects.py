"""Effects that may be missing in the drive of a rover on any set of wheels, from tables.toml."""

from collections.abc import Sequence
from dataclasses import replace

from sim_backends.models.interface import EffectCard
from sim_backends.models.tables import read_tables

PARAMETERS, CARDS = read_tables(__file__)


def effects_of(
    driven: Sequence[int], steered: Sequence[int], resistance: float, *, skids: bool
) -> tuple[EffectCard, ...]:
    """Return all cards of a rover.

    Args:
        driven: Numbers of its wheels with a motor, from 1.
        steered: Numbers of those that steer.
        resistance: Of the configured ground against rolling, per wheel load; in truth it may be less.
        skids: Wheels of two axles are fixed, so that a turn drags them sideways.
    """
    has = {
        "uneven_wheel": len(driven) > 1,
        "steering_offset": bool(steered),
        "steering_ratio": bool(steered),
        "rotation_centre": skids,
    }
    cards = {card.name: card for card in CARDS if has.get(card.name, True)}
    for name, wheels in (("uneven_wheel", driven), ("steering_offset", steered)):
        if name in cards:
            cards[name] = _of_one_wheel(cards[name], wheels)
    (share,) = cards["rolling_resistance"].parameters
    # Without any resistance the share is minus the configured one; a fit to that has an error.
    share = replace(share, lower=-2.0 * resistance)
    cards["rolling_resistance"] = replace(cards["rolling_resistance"], parameters=(share,))
    return tuple(cards.values())


def _of_one_wheel(card: EffectCard, wheels: Sequence[int]) -> EffectCard:
    """Return a card of one wheel, with the numbers that this wheel may have."""
    size, number = card.parameters
    first, last = float(min(wheels)), float(max(wheels))
    room = 0.0 if last > first else 0.4  # bounds differ, and round to the number
    number = replace(number, nominal=first, lower=first - room, upper=last + room)
    return replace(card, parameters=(size, number), shape_grid={"wheel": tuple(map(float, wheels))})
