"""Base parameters and effect definitions of the shipped models, from a file `tables.toml` beside each model.

A row of a parameter is a list: unit, nominal value, prior standard deviation, least value, greatest value,
meaning (see `Parameter`). What a definition leaves out is that of the same effect in `shared_cards.toml`.
"""

import tomllib
from pathlib import Path
from typing import Any

from sim_backends.models.interface import EffectCard, Parameter, parameter

SHARED_CARDS = tomllib.loads(Path(__file__).with_name("shared_cards.toml").read_text("utf-8"))


def read_tables(module: str) -> tuple[tuple[Parameter, ...], tuple[EffectCard, ...]]:
    """Return the base parameters and the effect definitions of a model, in the order of its file.

    Args:
        module: `__file__` of a module in the folder of the model.
    """
    tables = tomllib.loads(Path(module).with_name("tables.toml").read_text("utf-8"))
    cards = tables["effects"].items()
    return _parameters(tables["parameters"]), tuple(
        _card(name, SHARED_CARDS.get(name, {}) | card) for name, card in cards
    )


def _parameters(rows: dict[str, list[Any]]) -> tuple[Parameter, ...]:
    return tuple(parameter(name, *row) for name, row in rows.items())


def _card(name: str, card: dict[str, Any]) -> EffectCard:
    return EffectCard(
        name=name,
        sentence=card["sentence"],
        place=card["place"],
        parameters=_parameters(card["parameters"]),
        claims=tuple(card["claims"]),
        experiment=card["experiment"],
        source=card["source"],
        shape_grid={shape: tuple(values) for shape, values in card.get("shape_grid", {}).items()},
        releases=card.get("releases"),
    )
