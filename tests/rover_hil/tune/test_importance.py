"""Importance names the parameter that the cost depends on."""

from pathlib import Path

import numpy as np
import pytest

from rover_hil.tune.importance import importance
from rover_hil.tune.journal import Attempt
from rover_hil.tune.parameters import check_parameters
from tests.rover_hil.tune.tuning import make_config


def attempt(number: int, lookahead_m: float, gain_per_s: float, cost: float) -> Attempt:
    values = {"mission.lookahead_m": lookahead_m, "mission.heading_gain_per_s": gain_per_s}
    return Attempt(number=number, values=values, cost=cost, at_least=0.0, refused="", is_start=False)


def test_the_parameter_that_matters_has_the_share(tmp_path: Path) -> None:
    tune = check_parameters(make_config(tmp_path))
    rng = np.random.default_rng(1)
    attempts = []
    for number in range(30):
        lookahead_m, gain_per_s = 0.02 * 50.0 ** float(rng.random()), float(rng.uniform(0.5, 9.0))
        cost = float(np.exp(2.0 * np.log(lookahead_m / 0.1) ** 2 / np.log(50.0) ** 2))
        attempts.append(attempt(number, lookahead_m, gain_per_s, cost))
    found = importance(attempts, tune)
    assert found["mission.lookahead_m"] > 0.7  # chance explains the rest by the other parameter
    assert found["mission.heading_gain_per_s"] == pytest.approx(0.0, abs=1e-6)
    assert importance(attempts[:9], tune) == {}
