"""Mistakes in models that make their own predictions become one sentence."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.gap.data.load import check_model
from sim_backends.models.interface import Array, Run, Values
from tests.rover_hil.gap.gap_data import cart_runs
from tests.rover_hil.gap.gap_models import Cart

RUNS = cart_runs(1)[:3]
CHANNEL = Cart().channels[0].name


class Altered(Cart):
    """The cart with something wrong in what it predicts for its first run."""

    def __init__(self, mistake: str) -> None:
        super().__init__()
        self._mistake = mistake
        self._calls = 0

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        tables = super().predict(runs, parameters, effects)
        self._calls += 1
        if self._mistake == "run":
            return tables[1:]
        if self._mistake == "channel":
            del tables[0][CHANNEL]
        elif self._mistake == "shape":
            tables[0][CHANNEL] = np.zeros(7)
        elif self._mistake == "chance":
            tables[0][CHANNEL] = tables[0][CHANNEL] + 1e-9 * self._calls
        return tables


@pytest.mark.parametrize(
    ("mistake", "match"),
    [
        ("run", r"predict\(\) must return a list of 3 tables, one per run"),
        ("channel", rf"predict\(\) returns no {CHANNEL} for run "),
        ("shape", rf"predict\(\) returns {CHANNEL} with shape \(7,\) for run \S+, measured is \(1,\)"),
        ("chance", rf"is not deterministic: two predictions of {CHANNEL} differ"),
    ],
)
def test_a_mistake_in_a_prediction_is_one_sentence(mistake: str, match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        check_model(Altered(mistake), RUNS)


def test_a_sound_model_passes() -> None:
    check_model(Altered(""), RUNS)
