"""Fit what a lost share of the yaw's shake tells about slip, from drives with known truth."""

import math
from collections.abc import Sequence

import numpy as np

from controllers.slip.effort.yaw_excitation import LEAST_WAY_M, WINDOW_S, YawProbe, YawProbeMap, slip_of
from drivers.errors import LogError
from rover_hil.identify.run_data import Array, MeasuredRun, to_wheels
from rover_hil.identify.slip_fit import fit_rising_table

LEAST_WINDOWS = 100
SECTORS = 12
SECTOR_RAD = math.tau / SECTORS
LEAST_SHARE = 0.03
"""Share of the windows that makes a sector a trained direction: at corners every direction occurs."""


def probe_windows(run: MeasuredRun, probe: YawProbeMap) -> Array:
    """Return rows of lost share, true slip, and way by the wheels (m ahead, m to the left) of each window.

    Slip is what is missing of the wheels' way along its direction. The runs must give truth in metres.

    Raises:
        LogError: The run has no gyro.
    """
    if len(run.gyro) < 2:
        msg = f"log {run.path} holds no yaw rates of its gyro: the shake cannot be compared"
        raise LogError(msg)
    to_body = np.linalg.inv(to_wheels(run.rover))
    moved = np.diff(run.position_rad, axis=0) @ to_body.T
    elapsed_s = np.diff(run.t_s)
    gyro_rad_s = np.interp(run.t_s[1:], run.gyro[:, 0], run.gyro[:, 1])
    truth = np.array([np.interp(run.t_s, run.camera_t_s, column) for column in run.camera.T])
    middle_rad = 0.5 * (truth[2, 1:] + truth[2, :-1])
    true_m = np.diff(truth[0] + 1j * truth[1]) * np.exp(-1j * middle_rad)
    encoder_m = moved[:, 0] + 1j * moved[:, 1]
    finder = YawProbe(probe)
    rows: list[tuple[float, float, float, float]] = []
    first = 0
    for index, step_s in enumerate(elapsed_s.tolist()):
        shake = finder.step(step_s, moved[index, 2] / step_s, float(gyro_rad_s[index]))
        if shake is None:
            continue
        wheels_m, body_m = encoder_m[first : index + 1].sum(), true_m[first : index + 1].sum()
        first = index + 1
        if not shake.reason and abs(wheels_m) >= LEAST_WAY_M:
            slip = 1.0 - float((body_m / wheels_m).real)
            rows.append((shake.lost, slip, float(wheels_m.real), float(wheels_m.imag)))
    return np.array(rows).reshape(-1, 4)


def fit_probe(runs: Sequence[MeasuredRun], probe: YawProbeMap) -> YawProbeMap:
    """Return `probe` with the table fitted to `runs`.

    Raises:
        LogError: There is too little shaking in them, or one has no gyro.
    """
    rows = np.concatenate([probe_windows(run, probe) for run in runs])
    if len(rows) < LEAST_WINDOWS:
        msg = (
            f"{len(runs)} runs give {len(rows)} windows with a shake, fewer than {LEAST_WINDOWS}: drive more"
        )
        raise LogError(msg)
    lost, slips = fit_rising_table(rows[:, 0], rows[:, 1])
    if len(lost) < 2:
        msg = f"the shake loses {lost[0]:.2f} in all {len(runs)} runs: drive on firm and on soft ground"
        raise LogError(msg)
    fitted = probe.model_copy(update={"lost": lost, "slips": slips})
    left = rows[:, 1] - [slip_of(fitted, value) for value in rows[:, 0].tolist()]
    way_m = np.hypot(rows[:, 2], rows[:, 3])
    fast = way_m > np.median(way_m) / 2.0
    directions_rad = np.arctan2(rows[fast, 3], rows[fast, 2])
    sectors, counts = np.unique(np.round(directions_rad / SECTOR_RAD) % SECTORS, return_counts=True)
    driven = sectors[counts >= LEAST_SHARE * counts.sum()] * SECTOR_RAD
    low, high = np.quantile(way_m[fast] / WINDOW_S, (0.05, 0.95)).tolist()
    return fitted.model_copy(
        update={
            "slip_sd": float(left.std()),
            "directions_rad": tuple(driven.round(4).tolist()),
            "speed_range_m_s": (low, high),
        }
    )
