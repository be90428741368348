"""Error budget of a machine's channels: how much of the misfit is the sensor, and how much the model."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import stats

from rover_hil.gap.data.problem import Observations
from rover_hil.gap.parameters import MACHINES
from sim_backends.models.interface import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelError:
    """One channel's error, all in its unit.

    Attributes:
        channel: Its name.
        unit: Its unit.
        sensor_noise: Standard deviation that the channel declares, with its steps.
        model_error: Root mean square of what is left without the sensor's variance.
        run_scatter: The part of it that base parameters of each run's own explain, to first order; None
            where it is not known.
        upper: Upper 95 % bound of it, over runs.
        tolerance: Greatest model error that counts as agreement.
    """

    channel: str
    unit: str
    sensor_noise: float
    model_error: float
    run_scatter: float | None
    upper: float
    tolerance: float

    @property
    def is_good_enough(self) -> bool:
        """True where the model error is below the tolerance for certain."""
        return self.upper <= self.tolerance

    def sentence(self) -> str:
        """Return it in words."""
        ratio, unit = self.model_error / self.sensor_noise, "" if self.unit == "1" else f" {self.unit}"
        return (
            f"{self.channel}: model error {self.model_error:.3g}{unit}, {ratio:.2g} times the sensor noise "
            f"(upper bound {self.upper:.3g}{unit})"
        )


def error_budget(
    observations: Observations, residual: Array, parameters: int, run_scatter: Array | None = None
) -> tuple[ChannelError, ...]:
    """Return the budget of every channel.

    The residual is NaN where a value is missing; `run_scatter` is by channel, in its unit.
    """
    count = int(np.isfinite(residual).sum())
    factor = count / max(count - parameters, 1)
    found = []
    for index, channel in enumerate(observations.channels):
        noise = channel.noise_sd
        in_channel = (observations.channel == index) & np.isfinite(residual)
        squares = np.array(
            [
                factor * float(np.mean(residual[in_channel & (observations.site == site)] ** 2)) - noise**2
                for site in range(len(observations.groups))
                if np.any(in_channel & (observations.site == site))
            ]
        )
        sampling = noise**2 * math.sqrt(2.0 / max(int(in_channel.sum()), 1))
        error = float(np.std(squares, ddof=1)) / math.sqrt(squares.size) if squares.size > 1 else math.inf
        error = max(error, sampling)
        freedom = max(squares.size - 1, 1)
        upper = float(squares.mean()) + float(stats.t.ppf(MACHINES.budget.level, freedom)) * error
        found.append(
            ChannelError(
                channel=channel.name,
                unit=channel.unit,
                sensor_noise=noise,
                model_error=math.sqrt(max(float(squares.mean()), 0.0)),
                run_scatter=None if run_scatter is None else float(run_scatter[index]),
                upper=math.sqrt(max(upper, 0.0)),
                tolerance=channel.tolerance or MACHINES.budget.tolerance * noise,
            )
        )
    return tuple(found)
