"""Picture of an identified gyro: share and lag of its readings over the frequency of the turns."""

import cmath
import math

import numpy as np
from matplotlib.figure import Figure

from controllers.slip.effort.gyro_response import GyroResponse
from rover_hil.drives.arrays import Array
from rover_hil.pages import style
from rover_hil.ready.imu.parameters import GYRO_FIT
from rover_hil.ready.imu.turns import Turns

LEAST_AMPLITUDE_RAD_S = 0.03
"""Of the wheels' yaw rate; blocks with less are not drawn."""

TURNS = GYRO_FIT.turns


def measured_response(turns: Turns) -> tuple[Array, Array]:
    """Return frequency in Hz and complex share of the gyro's readings for each block, shape (m,) each.

    The frequency is that with the largest amplitude of the wheels' yaw rate in the block; the age of the
    wheels' positions is taken out.
    """
    responses: list[tuple[float, complex]] = []
    for start_s in turns.blocks.tolist():
        inside = (turns.grid_s >= start_s) & (turns.grid_s < start_s + TURNS.block_s)
        wheels = turns.wheel_rate_rad_s[inside]
        spectrum = np.abs(np.fft.rfft(wheels - wheels.mean(), 8 * len(wheels)))
        frequency_hz = float(np.argmax(spectrum) / (8 * len(wheels) * TURNS.grid_s))
        reads = (turns.gyro_s >= start_s) & (turns.gyro_s < start_s + TURNS.block_s)
        if frequency_hz <= 0.0 or reads.sum() < 8:
            continue
        by_wheels = _amplitude(frequency_hz, turns.grid_s[inside], wheels)
        by_gyro = _amplitude(frequency_hz, turns.gyro_s[reads], turns.gyro_rad_s[reads])
        if abs(by_wheels) >= LEAST_AMPLITUDE_RAD_S:
            late = cmath.exp(-1j * math.tau * frequency_hz * turns.wheel_age_s)
            responses.append((frequency_hz, by_gyro / by_wheels * late))
    return np.array([each for each, _ in responses]), np.array([each for _, each in responses])


def _amplitude(frequency_hz: float, t_s: Array, values: Array) -> complex:
    phase = math.tau * frequency_hz * t_s
    columns = np.column_stack((np.cos(phase), np.sin(phase), np.ones(len(t_s)), t_s - t_s.mean()))
    coefficients, *_ = np.linalg.lstsq(columns, values, rcond=None)
    return complex(coefficients[0], -coefficients[1])


def draw_response(turns: Turns, response: GyroResponse) -> Figure:
    """Draw what each block measured and the identified constants."""
    frequency_hz, shares = measured_response(turns)
    curve_hz = np.linspace(0.2, max(10.0, float(frequency_hz.max(initial=0.0)) + 1.0), 200)
    curve = np.array([response.at(each) for each in curve_hz.tolist()])
    figure = Figure(figsize=(style.WIDTH_IN, 5.0), layout="constrained")
    share, lag = figure.subplots(2, 1, sharex=True)
    share.plot(
        frequency_hz, np.abs(shares), "o", color=style.TRUTH, markersize=4, label="measured, per second"
    )
    share.plot(curve_hz, np.abs(curve), color=style.ESTIMATE, label="identified")
    share.set(ylabel="reading / turn of the wheels", ylim=(0.0, 1.5))
    share.legend()
    lag.plot(frequency_hz, _lag_ms(frequency_hz, shares), "o", color=style.TRUTH, markersize=4)
    lags_ms = [1e3 * response.lag_s(each) for each in curve_hz.tolist()]
    lag.plot(curve_hz, lags_ms, color=style.ESTIMATE)
    lag.set(xlabel="frequency of the turns (Hz)", ylabel="lag (ms)")
    return figure


def _lag_ms(frequency_hz: Array, shares: Array) -> Array:
    lag: Array = -1e3 * np.angle(shares) / (math.tau * frequency_hz)
    return lag
