"""What every model owes its users."""

import numpy as np

from sim_backends.models.interface import Model, Run

NULL_TOLERANCE = 1e-12


def assert_nulls_change_nothing(model: Model, runs: list[Run]) -> None:
    """Base and base with each effect at its null must agree to 1e-12 of the channel's size."""
    base = model.predict(runs, {}, {})
    for card in model.effects:
        null = {item.name: item.nominal for item in card.parameters}
        points = [null] + [
            {**null, shape: value} for shape, values in card.shape_grid.items() for value in values
        ]
        for point in points:
            changed = model.predict(runs, {}, {card.name: point})
            for before, after in zip(base, changed, strict=True):
                for channel in model.channels:
                    size = max(float(np.abs(before[channel.name]).max()), 1.0)
                    gap = np.abs(before[channel.name] - after[channel.name]).max()
                    assert gap <= NULL_TOLERANCE * size, (card.name, point, channel.name)


def assert_effects_act(model: Model, runs: list[Run], *, but: tuple[str, ...] = ()) -> None:
    """Every effect must change some channel of some run at its natural size."""
    base = model.predict(runs, {}, {})
    for card in model.effects:
        sizes = []
        strength = card.parameters[0]
        for shapes in _shapes(model, card.name):
            tables = model.predict(runs, {}, {card.name: {strength.name: strength.prior_sd, **shapes}})
            sizes += [
                float(np.abs(one[channel.name] - other[channel.name]).max())
                for one, other in zip(base, tables, strict=True)
                for channel in model.channels
            ]
        assert (max(sizes) > 0.0) == (card.name not in but), card.name


def _shapes(model: Model, name: str) -> list[dict[str, float]]:
    card = next(one for one in model.effects if one.name == name)
    return [{shape: value} for shape, values in card.shape_grid.items() for value in values] or [{}]


def assert_cards_are_whole(model: Model) -> None:
    """Names, units, sentences, bounds; a released parameter must be one of the base."""
    names = [card.name for card in model.effects]
    assert len(set(names)) == len(names)
    own = {item.name for item in model.parameters}
    for card in model.effects:
        assert card.sentence.endswith(".")
        assert card.place
        assert card.claims
        assert card.experiment
        assert card.source
        assert card.releases is None or card.releases in own
        assert set(card.shape_grid) <= {item.name for item in card.parameters[1:]}
        for item in card.parameters:
            assert item.unit
            assert item.prior_sd > 0.0
            assert item.lower <= item.nominal <= item.upper
            assert item.lower < item.upper
    for item in model.parameters:
        assert item.unit
        assert item.lower < item.nominal < item.upper
