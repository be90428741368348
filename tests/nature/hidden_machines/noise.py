"""Readings of a sensor: white or coloured noise, then rounding to its resolution."""

import numpy as np

from tests.nature.hidden_machines.machine import Array, Sensor


def read(
    series: Array, sensor: Sensor, correlation: float, rng: np.random.Generator, factor: float = 1.0
) -> Array:
    """Return the readings of a series of shape (runs, samples).

    `correlation` is that of successive readings' noise, `factor` the noise's standard deviation over `sigma`.
    """
    white = rng.normal(0.0, 1.0, series.shape)
    noise = np.empty_like(white)
    noise[:, 0] = white[:, 0]
    for k in range(1, series.shape[1]):
        noise[:, k] = correlation * noise[:, k - 1] + np.sqrt(1.0 - correlation**2) * white[:, k]
    readings = series + factor * sensor.sigma * noise
    return np.asarray(sensor.quantum * np.round(readings / sensor.quantum) if sensor.quantum else readings)
