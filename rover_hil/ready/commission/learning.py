"""How much of the secant reading and of the bracket's width to take, by labelled readings of this rover.

Linear regression with a prior (Bishop 2006, Pattern Recognition and Machine Learning, section 3.3): p and q
are taken to be anywhere within half to either side of the formula's: a standard deviation of 1 / sqrt(12).
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controllers.slip.effort.labelled_windows import LabelledReading
from controllers.slip.effort.learned_bracket import (
    PLAIN,
    SMOOTH,
    Driven,
    LearnedBracket,
    conditions_of,
)
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.settings import SlipSettings
from controllers.slip.effort.slip_bracket import DrivenTravel
from drivers.clock import date_of, wall_time_ns
from rover_hil.drives.arrays import Array, rms
from rover_hil.drives.toml_text import toml_text
from rover_hil.pages.atomic_write import write_file
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.replay import estimate_again

PRIOR = np.array([1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
PRIOR_SD = np.array([1.0, 1.0, 0.5, 0.5, 0.5, 0.5, 0.5]) / math.sqrt(12.0)
"""Changes of p and q with response, speed and force are at most half as large as their own."""
LEAST_SD = 0.02
"""Of a reading about what was learned: windows of the excitation are noisy."""
DRIFT_PRIOR_SD = 0.5
"""Of drift over slip, rad: a rover that slips wholly may go aside by half a radian."""
GREATEST_DRIFT = 1.5
SURE = 3.0
"""A drift is one from so many of its standard deviations on: 1 in 370 is noise."""
LEAST_LABELS = 20
"""Fewer teach nothing: with 5 labels the reading is as far off as by the prior."""
LEAST_SMOOTH = 40
"""From so many on p and q may change with response, speed and force, where that leaves a smaller residual."""


class LearnedReading(NamedTuple):
    """What a commissioning has learned, None for nothing, and what to say about it."""

    bracket: LearnedBracket | None
    words: str


def learn_reading(logs: Sequence[Path], path: Path, slip: SlipSettings) -> LearnedReading:
    """Learn the reading of the yaw excitation where fixes or a camera have measured the slip, into a file.

    Raises:
        LogError: A log is damaged.
    """
    labels = [label for log in logs for label in read_labels(log)]
    if len(labels) < LEAST_LABELS:
        words = (
            f"nothing: fixes or camera have labelled {len(labels)} readings of the yaw excitation, "
            f"{LEAST_LABELS} are needed: drive more laps"
        )
        return LearnedReading(None, words)
    learned = learn_bracket(
        labels,
        str(path.parent),
        date_of(wall_time_ns()).isoformat(),
        conditions_of(slip.excitation, slip.gyro_response),
    )
    write_file(path, toml_text(learned.model_dump(exclude_none=True), digits=5))
    before = rms(np.array([each.slip - each.secant - EFFORT.bracket.weight * each.width for each in labels]))
    secant_share, width_share, *others = learned.weights
    drift = (
        f"drift of {learned.drift_per_slip:+.2f} rad per slip (scatter {learned.drift_sd_rad:.2f} rad), "
        if learned.drift_per_slip
        else ""
    )
    changes = ", changing with response, speed and force" if others else ""
    words = (
        f"{secant_share:.2f} of the secant and {width_share:.2f} of the width{changes}, {drift}from "
        f"{learned.windows} readings, off one that was left out by {learned.residual_sd:.3f} (rms; "
        f"{before:.3f} with the fixes' noise by the formula); written to {path}; in the configuration: "
        f'[slip] learned_bracket = "{path}"'
    )
    return LearnedReading(learned, words)


def read_labels(path: Path) -> list[LabelledReading]:
    """Return the readings of the yaw excitation in a log that its fixes or camera have labelled.

    Raises:
        LogError: The log is damaged.
    """
    log = LogReader(path)
    with restore_config(log) as config:
        reports = [output.slip for output in estimate_again(log, config)]
    return [report.label for report in reports if report is not None and report.label is not None]


def learn_bracket(
    labels: Sequence[LabelledReading], source: str, learned_on: str, conditions: str = ""
) -> LearnedBracket:
    """Return what labelled readings teach.

    Args:
        labels: At least `LEAST_LABELS`.
        source: Where they are from.
        learned_on: Day, as 2026-01-31.
        conditions: Excitation and gyro; empty for any.
    """
    forces_n = [label.force_n for label in labels if label.force_n is not None]
    driven = Driven(
        secant=_range([label.secant for label in labels]),
        width=_range([label.width for label in labels]),
        speed_m_s=_range([label.speed_m_s for label in labels]),
        force_n=_range(forces_n) if len(forces_n) == len(labels) else None,
    )
    learned = _learn(labels, driven, PLAIN)
    if len(labels) >= LEAST_SMOOTH:
        learned = min(learned, _learn(labels, driven, SMOOTH), key=lambda each: each.residual_sd)
    drift_per_slip, drift_sd_rad = _learn_drift(labels)
    return LearnedBracket(
        source=source,
        conditions=conditions,
        drift_per_slip=drift_per_slip,
        drift_sd_rad=drift_sd_rad,
        learned_on=learned_on,
        windows=len(labels),
        weights=tuple(learned.weights.tolist()),
        covariance=tuple(learned.covariance.ravel().tolist()),
        residual_sd=learned.residual_sd,
        secant_range=driven.secant,
        width_range=driven.width,
        speed_range_m_s=driven.speed_m_s,
        force_range_n=driven.force_n,
    )


def _learn_drift(labels: Sequence[LabelledReading]) -> tuple[float, float]:
    """Return drift over slip, and the scatter of the drift about it; 0 where it is none but noise.

    A regression through the origin, with the prior that there is none.
    """
    known = [(label.slip, label.drift_rad) for label in labels if label.drift_rad is not None]
    if len(known) < LEAST_LABELS:
        return 0.0, 0.0
    slips, drifts_rad = np.array(known).T
    squares = float(slips @ slips)
    scatter_rad = float(rms(drifts_rad))
    per_slip = float(slips @ drifts_rad) / (squares + scatter_rad**2 / DRIFT_PRIOR_SD**2)
    left_rad = float(rms(drifts_rad - per_slip * slips))
    if abs(per_slip) * math.sqrt(squares) <= SURE * left_rad:
        return 0.0, scatter_rad
    return float(np.clip(per_slip, -GREATEST_DRIFT, GREATEST_DRIFT)), left_rad


class _Weights(NamedTuple):
    """Weights, their covariance, and the residual of readings that were left out."""

    weights: Array
    covariance: Array
    residual_sd: float


def _learn(labels: Sequence[LabelledReading], driven: Driven, count: int) -> _Weights:
    """Learn the first `count` weights."""
    rows = np.array(
        [
            driven.terms(each.secant, each.width, DrivenTravel(each.speed_m_s, each.force_n), count)
            for each in labels
        ]
    )
    slips = np.array([label.slip for label in labels])
    noise_sd = np.array([label.slip_sd for label in labels])
    residual_sd = LEAST_SD
    for _ in range(5):  # the scatter and the weights depend on each other
        sd = np.hypot(residual_sd, noise_sd)
        weights, covariance = _fit(rows, slips, sd)
        residual_sd = _left_out_sd(rows, slips, sd, noise_sd)
    return _Weights(weights, covariance, residual_sd)


def _fit(rows: Array, slips: Array, sd: Array) -> tuple[Array, Array]:
    """Return the mean and the covariance of the weights."""
    count = rows.shape[1]
    weighted, precision = rows / sd[:, None], 1.0 / PRIOR_SD[:count] ** 2
    covariance = np.asarray(np.linalg.inv(weighted.T @ weighted + np.diag(precision)), dtype=np.float64)
    weights: Array = covariance @ (weighted.T @ (slips / sd) + PRIOR[:count] * precision)
    return weights, covariance


def _left_out_sd(rows: Array, slips: Array, sd: Array, noise_sd: Array) -> float:
    """Return the rms of each slip about what the others give for it, without the noise of the fixes."""
    squares = []
    for left_out in range(len(slips)):
        others = np.arange(len(slips)) != left_out
        weights, _ = _fit(rows[others], slips[others], sd[others])
        squares.append((slips[left_out] - rows[left_out] @ weights) ** 2)
    return max(LEAST_SD, math.sqrt(max(0.0, float(np.mean(squares) - np.mean(noise_sd**2)))))


def _range(values: Sequence[float] | Array) -> tuple[float, float]:
    return float(np.min(values)), float(np.max(values))
