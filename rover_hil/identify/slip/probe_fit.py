"""Fit slip over the transmission loss of the yaw excitation, to drives with known truth."""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.yaw_excitation import (
    YawExcitation,
    YawExcitationMap,
    sensor_response,
    slip_of,
)
from drivers.errors import LogError
from rover_hil.datasets.arrays import Array
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import MeasuredRun, to_wheels
from rover_hil.identify.slip.wheel_fit import fit_rising_table
from rover_hil.identify.slip.windows import TOO_NOISY, slip_problem

NO_FIX_NEAR = f"no pose fix within {SLIP_FIT.probe.fix_reach_s:g} s of the ends of a window"
CURABLE = (TOO_NOISY, NO_FIX_NEAR)
"""Problems that a longer window may solve."""


def probe_windows(run: MeasuredRun, probe: YawExcitationMap) -> tuple[Array, Counter[str]]:
    """Return windows as rows: transmission loss, true slip, distance of the wheels in m forward and left, s.

    Slip is the part of the wheels' distance that is missing along its direction. A window is half a second;
    with noisy pose fixes it is as many half seconds as make the slip known well enough. The second result
    counts the windows that were rejected, by reason. The runs must give poses in metres.

    Raises:
        LogError: The run has no gyro.
    """
    if len(run.gyro) < 2:
        raise LogError(
            f"log {run.path} holds no yaw rates of its gyro: the transmission loss cannot be measured"
        )
    to_body = np.linalg.inv(to_wheels(run.rover))
    moved = np.diff(run.position_rad, axis=0) @ to_body.T
    elapsed_s = np.diff(run.t_s)
    gyro_rad_s = np.interp(run.t_s[1:], run.gyro[:, 0], run.gyro[:, 1])
    truth = np.array([np.interp(run.t_s, run.camera_t_s, column) for column in run.camera.T])
    middle_rad = 0.5 * (truth[2, 1:] + truth[2, :-1])
    true_m = np.diff(truth[0] + 1j * truth[1]) * np.exp(-1j * middle_rad)
    encoder_m = moved[:, 0] + 1j * moved[:, 1]
    excitation = YawExcitation(probe, sensor_response(probe, run.gyro_response, 0.0))
    rows: list[tuple[float, ...]] = []
    rejected: Counter[str] = Counter()
    losses: list[float] = []
    first = 0
    for index, step_s in enumerate(elapsed_s.tolist()):
        response = excitation.step(step_s, moved[index, 2] / step_s, float(gyro_rad_s[index]))
        if response is None:
            continue
        if not response.reason:
            losses.append(response.transmission_loss)
            problem = _slip_problem(run, first, index + 1)
            if problem in CURABLE and run.t_s[index + 1] - run.t_s[first] < SLIP_FIT.window.longest_s:
                continue
            wheels_m, body_m = encoder_m[first : index + 1].sum(), true_m[first : index + 1].sum()
            if problem:
                rejected[problem] += 1
            elif abs(wheels_m) >= EFFORT.excitation.least_distance_m:
                slip = 1.0 - float((body_m / wheels_m).real)
                duration_s = len(losses) * EFFORT.excitation.window_s
                loss = sum(losses) / len(losses)
                rows.append((loss, slip, float(wheels_m.real), float(wheels_m.imag), duration_s))
        losses, first = [], index + 1
    return np.array(rows).reshape(-1, 5), rejected


def _slip_problem(run: MeasuredRun, start: int, end: int) -> str:
    """Return why the slip between two readings of the wheels is not known well enough; empty where it is."""
    if run.fix_sd_m is None:
        return ""
    times_s = run.t_s[[start, end]]
    first, last = (int(np.argmin(np.abs(run.camera_t_s - time_s))) for time_s in times_s)
    if np.abs(run.camera_t_s[[first, last]] - times_s).max() > SLIP_FIT.probe.fix_reach_s:
        return NO_FIX_NEAR
    moved_m = run.rover.wheel_radius_m * float(np.abs(run.position_rad[end] - run.position_rad[start]).max())
    return slip_problem(run, first, last, moved_m)


def fit_probe(runs: Sequence[MeasuredRun], probe: YawExcitationMap) -> tuple[YawExcitationMap, Counter[str]]:
    """Return `probe` with the table fitted to `runs`, and how many windows were rejected, by reason.

    Raises:
        LogError: There is too little yaw excitation in them, or one has no gyro.
    """
    windows = [probe_windows(run, probe) for run in runs]
    rows = np.concatenate([found for found, _ in windows])
    rejected = sum((counts for _, counts in windows), Counter[str]())
    if len(rows) < SLIP_FIT.probe.least_windows:
        reasons = "".join(f"; {count} rejected: {reason}" for reason, count in rejected.items())
        raise LogError(
            f"{len(runs)} runs give {len(rows)} windows with excitation, "
            f"{SLIP_FIT.probe.least_windows} needed: drive more{reasons}"
        )
    losses, slips = fit_rising_table(rows[:, 0], rows[:, 1])
    if len(losses) < 2:
        raise LogError(
            f"all {len(runs)} runs lose {losses[0]:.2f} of the excitation: drive on firm and on soft ground"
        )
    fitted = probe.model_copy(update={"transmission_losses": losses, "slips": slips})
    residual = rows[:, 1] - [slip_of(fitted, value) for value in rows[:, 0].tolist()]
    distance_m = np.hypot(rows[:, 2], rows[:, 3])
    fast = distance_m > SLIP_FIT.probe.fast_share * np.median(distance_m)
    directions_rad = np.arctan2(rows[fast, 3], rows[fast, 2])
    sector_rad = math.tau / SLIP_FIT.probe.sectors
    sectors, counts = np.unique(
        np.round(directions_rad / sector_rad) % SLIP_FIT.probe.sectors, return_counts=True
    )
    driven = sectors[counts >= SLIP_FIT.probe.least_share * counts.sum()] * sector_rad
    low, high = np.quantile(distance_m[fast] / rows[fast, 4], (0.05, 0.95)).tolist()
    fitted = fitted.model_copy(
        update={
            "slip_sd": float(residual.std()),
            "directions_rad": tuple(driven.round(4).tolist()),
            "speed_range_m_s": (low, high),
        }
    )
    return fitted, rejected
