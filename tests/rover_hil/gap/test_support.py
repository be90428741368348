"""What runs say of a fitted number, beside what samples say."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rover_hil.gap.data.problem import Free, Indices
from rover_hil.gap.statistics.fit import Fit
from rover_hil.gap.statistics.jackknife import clusters, is_clearly_worse, jackknife
from rover_hil.gap.statistics.parameters import STATISTICS
from sim_backends.models.interface import Array

KEY = ("drag", "size")
SAMPLES = 200


@dataclass(frozen=True)
class Flat:
    """Errors that are independent and of unit size already."""

    site: Indices
    block: Indices
    freedom: float = np.inf

    @property
    def row_sd(self) -> Array:
        return np.ones(self.site.size)

    @property
    def channel(self) -> Indices:
        return np.zeros(self.site.size, dtype=np.intp)

    def whiten(self, rows: Array) -> Array:
        return rows


def noise_of(runs: int) -> Flat:
    site = np.repeat(np.arange(runs), SAMPLES).astype(np.intp)
    return Flat(site=site, block=np.arange(site.size, dtype=np.intp) // (SAMPLES // 4))


def fitted(strengths: Array, rng: np.random.Generator, shown: Array | None = None) -> tuple[Fit, Flat]:
    """Fit one strength to runs each of which has its own; `shown` says how much of it a run shows."""
    noise = noise_of(strengths.size)
    shape = np.tile(np.sin(np.linspace(0.0, 9.0, SAMPLES)), strengths.size)
    shape = shape * (1.0 if shown is None else np.repeat(shown, SAMPLES))
    values = np.repeat(strengths, SAMPLES) * shape + rng.standard_normal(shape.size)
    pull = float(shape @ values / (shape @ shape + 1.0))
    free = Free(key=KEY, mean=0.0, sd=1.0, lower=-np.inf, upper=np.inf, start=0.0, step=0.1)
    residual = values - pull * shape
    return (
        Fit(
            free=(free,),
            point={KEY: pull},
            residual=residual,
            jacobian=shape[:, None],
            pull=np.array([pull]),
            cost=float(residual @ residual + pull**2),
        ),
        noise,
    )


@pytest.mark.parametrize("runs", [3, 6, 12])
def test_runs_that_agree_are_as_sure_as_their_samples(runs: int) -> None:
    fit, noise = fitted(np.full(runs, 1.0), np.random.default_rng(1))
    (found,) = jackknife(fit, noise, [KEY])
    assert 5.0 < found.z <= fit.pull[0] / fit.standard_error(KEY) + 1e-9
    assert 1.0 <= found.widening < 2.5


def test_runs_that_disagree_take_away_what_samples_are_sure_of() -> None:
    rng = np.random.default_rng(2)
    fit, noise = fitted(1.0 * rng.standard_normal(9) + 0.3, rng)
    (found,) = jackknife(fit, noise, [KEY])
    by_samples = abs(fit.pull[0]) / fit.standard_error(KEY)
    assert by_samples > 5.0
    assert abs(found.z) < 3.0
    assert found.widening > 3.0


def test_without_effect_runs_that_scatter_seldom_ask_for_one() -> None:
    rng = np.random.default_rng(3)
    z = np.array([jackknife(*fitted(rng.standard_normal(9), rng), [KEY])[0].z for _ in range(1000)])
    # 5 and 0.5 % would be perfect; what is left of the belief in the samples costs the rest.
    assert np.mean(np.abs(z) > 1.96) < 0.075
    assert np.mean(np.abs(z) > 2.81) <= 0.015


def test_one_run_that_shows_it_clearly_is_enough() -> None:
    shown = np.array([10.0, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
    fit, noise = fitted(np.full(8, 1.0), np.random.default_rng(4), shown)
    assert jackknife(fit, noise, [KEY])[0].z > 4.0


@given(seed=st.integers(0, 1000), sign=st.sampled_from([-1.0, 1.0]))
def test_z_has_the_sign_of_the_strength_and_never_exceeds_that_of_samples(seed: int, sign: float) -> None:
    rng = np.random.default_rng(seed)
    fit, noise = fitted(sign * (0.5 + 0.2 * rng.standard_normal(7)), rng)
    (found,) = jackknife(fit, noise, [KEY])
    assert found.z == 0.0 or np.sign(found.z) == np.sign(fit.pull[0])
    assert abs(found.z) <= abs(fit.pull[0]) / fit.standard_error(KEY) + 1e-9


def test_a_run_that_holds_almost_everything_is_no_division_by_zero() -> None:
    shown = np.array([1e8, 1.0, 1.0, 1.0, 1.0, 1.0])
    fit, noise = fitted(np.full(6, 1.0), np.random.default_rng(4), shown)
    (found,) = jackknife(fit, noise, [KEY])
    assert np.isfinite(found.z)
    assert np.isfinite(found.widening)


def test_few_runs_are_cut_into_stretches() -> None:
    assert (
        np.unique(clusters(noise_of(STATISTICS.jackknife.least_runs))).size == STATISTICS.jackknife.least_runs
    )
    assert np.unique(clusters(noise_of(STATISTICS.jackknife.least_runs - 1))).size == 4 * (
        STATISTICS.jackknife.least_runs - 1
    )


def test_a_rival_is_clearly_worse_only_where_most_runs_say_so() -> None:
    best, noise = fitted(np.full(9, 1.0), np.random.default_rng(5))
    everywhere = replace(best, residual=best.residual + 0.5 * best.jacobian[:, 0])
    once = np.where(noise.site == 0, 3.0, 0.0) * best.jacobian[:, 0]
    in_one_run = replace(best, residual=best.residual + once)
    assert is_clearly_worse(everywhere, best, noise, 0.99)
    assert not is_clearly_worse(in_one_run, best, noise, 0.99)
    assert not is_clearly_worse(best, best, noise, 0.99)
