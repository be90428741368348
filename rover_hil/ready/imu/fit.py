"""Gain, delay and first-order lag of a gyro, by least squares over the turns of the wheels.

The yaw rate of the wheels, passed through the spring of the contacts, a low-pass and a delay, is fitted to
the readings of the gyro, with a constant and a trend in each block. The same is fitted for rigid contacts,
and for a gyro without a low-pass: the simplest of the three is used that explains the readings as well. The
standard deviations are those of a jackknife over groups of blocks, as errors within a block are not
independent, and half of the difference to a model that the readings do not refute.

Assumptions: the wheels roll or spring, they do not slide; the body has no other dynamics. In place the spring
and a drag of the contacts cannot be distinguished from a slow gyro: where they change the response at the
frequency of the yaw excitation, the result is refused.
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from controllers.slip.effort.yaw_excitation import ExcitationSettings
from rover_hil.drives.arrays import Array
from rover_hil.ready.imu.contact import ContactSpring
from rover_hil.ready.imu.parameters import GYRO_FIT
from rover_hil.ready.imu.turns import Turns

TURNS, RESPONSE = GYRO_FIT.turns, GYRO_FIT.response


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseFit:
    """What came out.

    Attributes:
        gain: Of the gyro over the wheels.
        delay_s: Of the gyro, the age of the wheels' positions taken out.
        lag_s: Time constant of the low-pass.
        gain_sd, delay_sd_s, lag_sd_s: Standard deviations.
        contact: The contacts' spring; None for rigid ones.
        excitation_hz: Frequency of the yaw excitation, for which the constants are.
        residual: Standard deviation of what the fit leaves, over that of the readings.
        left_out: The same in blocks that were left out of the fit; 0 for a fit of all.
        left_out_without: The same with gain 1, no lag, and the known age of the wheels' positions alone.
        seconds: Of turns that were used.
    """

    gain: float
    delay_s: float
    lag_s: float
    gain_sd: float
    delay_sd_s: float
    lag_sd_s: float
    residual: float
    seconds: float
    contact: ContactSpring | None = None
    excitation_hz: float = ExcitationSettings().frequency_hz
    left_out: float = 0.0
    left_out_without: float = 0.0

    @property
    def bandwidth_hz(self) -> float:
        """Where the low-pass has lost 3 dB, at most `greatest_bandwidth_hz`."""
        return min(RESPONSE.greatest_bandwidth_hz, 1.0 / (math.tau * max(self.lag_s, 1e-6)))

    @property
    def bandwidth_sd_hz(self) -> float:
        """Standard deviation of the bandwidth, at most the bandwidth itself."""
        return min(self.bandwidth_hz, self.bandwidth_hz * self.lag_sd_s / max(self.lag_s, 1e-6))

    @property
    def problem(self) -> str:
        """Why the result must not be used; empty where it may."""
        if self.residual > RESPONSE.greatest_residual:
            return (
                f"{100 * self.residual:.0f} % of the readings are not explained by the wheels' turns: firm "
                "ground, a free rover and the right axis of the gyro are needed"
            )
        return self._contradicts() or self._springs() or self._predicts_nothing()

    def _springs(self) -> str:
        """Return why the contacts hide the gyro; empty where they do not."""
        if self.contact is None:
            return ""
        turn = self.contact.response(self.excitation_hz)
        further = abs(abs(turn) - 1.0) > RESPONSE.greatest_spring
        if not further and abs(cmath.phase(turn)) <= RESPONSE.greatest_spring:
            return ""
        return (
            f"the rover springs on its wheels at {self.contact.frequency_hz:.0f} Hz, so that gain and delay "
            "of the gyro cannot be distinguished from those of the ground: turn on a hard floor"
        )

    def _contradicts(self) -> str:
        """Return why the gain cannot be that of a gyro; empty where it can."""
        limit = RESPONSE.deviations * math.hypot(self.gain_sd, RESPONSE.gain_tolerance)
        if abs(self.gain - 1.0) <= limit:
            return ""
        return (
            f"the gyro reads {self.gain:.2f} of the wheels' turns, and its data sheet allows 1 +- "
            f"{RESPONSE.deviations * RESPONSE.gain_tolerance:.2f}: the ground is not firm, the wheels' "
            "geometry in [rover] is wrong, or the sensor is mounted another way"
        )

    def _predicts_nothing(self) -> str:
        """Return that the constants predict turns that were not fitted no better; empty where they do."""
        if self.left_out <= RESPONSE.better * self.left_out_without:
            return ""
        return (
            f"turns that were left out of the fit are predicted to {100 * self.left_out:.0f} % with these "
            f"constants, and to {100 * self.left_out_without:.0f} % without: they are not needed"
        )


def fit_response(turns: Turns, excitation_hz: float = ExcitationSettings().frequency_hz) -> ResponseFit:
    """Return the constants of the gyro that fit the turns best.

    Args:
        turns: The turns.
        excitation_hz: Frequency of the yaw excitation that they are for.
    """
    count = min(RESPONSE.groups, len(turns.blocks))
    groups = [turns.blocks[first::count] for first in range(count)]
    starts_s = RESPONSE.starts_s

    def best_of(starts: Sequence[Numbers]) -> ResponseFit:
        return min((_fit(turns, turns.blocks, start) for start in starts), key=lambda each: each.residual)

    late = best_of([(delay_s, 0.0, *RIGID) for delay_s, _ in starts_s])
    slow = best_of([(*start, *RIGID) for start in starts_s])
    rigid = slow if _explains(slow, late) else late
    springing = best_of(
        [(delay_s, rigid.lag_s, *spring) for delay_s, _ in starts_s[:2] for spring in RESPONSE.springs_s]
    )
    best = springing if _explains(springing, rigid) else rigid
    others = [_fit(turns, np.setdiff1d(turns.blocks, group), _start_of(best)) for group in groups]
    least_sd_s = RESPONSE.same_rate_sd_s if turns.rates_ratio < RESPONSE.same_rate else RESPONSE.least_sd_s

    def deviation(name: str) -> float:
        values = np.array([getattr(each, name) for each in others])
        return float(np.sqrt((len(values) - 1) * np.mean((values - values.mean()) ** 2)))

    # What is not refuted may be true: half of the difference to it. Its low-pass, and the spring's whole lag.
    by_slow_s = 0.5 * slow.lag_s if rigid is late else 0.0
    by_spring_s = 0.5 * (springing.delay_s + springing.lag_s - rigid.delay_s - rigid.lag_s)
    by_gain = 0.5 * max(abs(each.gain - rigid.gain) for each in (slow, springing))
    return replace(
        best,
        delay_s=best.delay_s + turns.wheel_age_s,
        excitation_hz=excitation_hz,
        gain_sd=math.hypot(deviation("gain"), RESPONSE.least_gain_sd, by_gain),
        delay_sd_s=math.hypot(deviation("delay_s"), least_sd_s, max(abs(by_spring_s), by_slow_s)),
        lag_sd_s=math.hypot(deviation("lag_s"), least_sd_s, by_slow_s),
        left_out=_left_out(turns, groups, others),
        # The age of the wheels' positions is known without a calibration.
        left_out_without=_left_out(turns, groups, [replace(NO_GYRO, delay_s=-turns.wheel_age_s)] * count),
    )


def _explains(larger: ResponseFit, smaller: ResponseFit) -> bool:
    """Return whether what a larger model has in addition explains a part of the readings that counts."""
    return smaller.residual**2 - larger.residual**2 > RESPONSE.least_explained**2


RIGID = (0.0, 0.0, 0.0)
"""Period, damping and drag of contacts that do not spring."""
NO_GYRO = ResponseFit(
    gain=1.0,
    delay_s=0.0,
    lag_s=0.0,
    gain_sd=0.0,
    delay_sd_s=0.0,
    lag_sd_s=0.0,
    residual=0.0,
    seconds=0.0,
)
Numbers = tuple[float, ...]
"""Delay and lag of the gyro; period, damping and drag of the contacts."""


def _start_of(fit: ResponseFit) -> Numbers:
    return (fit.delay_s, fit.lag_s, *(RIGID if fit.contact is None else fit.contact))


class _Readings:
    """Readings of the gyro in some blocks, and what the wheels' turns predict for them.

    Attributes:
        measured: Without a constant and a trend in each block, shape (k,).
    """

    def __init__(self, turns: Turns, blocks: Array) -> None:
        self._turns = turns
        self._parts = [
            np.flatnonzero((turns.gyro_s >= block) & (turns.gyro_s < block + TURNS.block_s))
            for block in blocks.tolist()
        ]
        self.measured = self._detrended(turns.gyro_rad_s)

    def predicted(self, numbers: Numbers) -> Array:
        """Return the prediction for a gyro of gain 1, shape (k,)."""
        turns, (delay_s, lag_s, *spring) = self._turns, numbers
        body = turns.wheel_rate_rad_s
        if spring[0] > 0.0:
            body = ContactSpring(*spring).body_rate(body, TURNS.grid_s)
        keep = math.exp(-TURNS.grid_s / max(lag_s, RESPONSE.shortest_lag_s))
        slow = lfilter([1.0 - keep], [1.0, -keep], body)
        # The discrete low-pass is half a step earlier than the continuous one.
        return self._detrended(np.interp(turns.gyro_s - delay_s - 0.5 * TURNS.grid_s, turns.grid_s, slow))

    def _detrended(self, values: Array) -> Array:
        t_s = self._turns.gyro_s
        return np.concatenate([_without_trend(t_s[part], values[part]) for part in self._parts])


def _left_out(turns: Turns, groups: Sequence[Array], fits: Sequence[ResponseFit]) -> float:
    """Return what fits leave of the readings in the groups that they have not seen, as a share."""
    rests, measured = [], []
    for group, fit in zip(groups, fits, strict=True):
        readings = _Readings(turns, group)
        rests.append(readings.measured - fit.gain * readings.predicted(_start_of(fit)))
        measured.append(readings.measured)
    return float(np.std(np.concatenate(rests)) / np.std(np.concatenate(measured)))


def _fit(turns: Turns, blocks: Array, start: Numbers) -> ResponseFit:
    """Return the best fit from a start; without a lag or a period there, it has no low-pass or spring."""
    readings, free = _Readings(turns, blocks), [0, *(index for index in range(1, 5) if start[index] > 0.0)]
    measured = readings.measured

    def gain_of(predicted: Array) -> float:
        return float(predicted @ measured) / float(predicted @ predicted)

    def numbers_of(values: Array) -> Numbers:
        numbers = list(start)
        for index, value in zip(free, values.tolist(), strict=True):
            numbers[index] = value
        return tuple(numbers)

    def rest(values: Array) -> Array:
        predicted = readings.predicted(numbers_of(values))
        return measured - gain_of(predicted) * predicted

    solution = least_squares(
        rest,
        [start[index] for index in free],
        bounds=[[bounds[index] for index in free] for bounds in (RESPONSE.least_s, RESPONSE.greatest_s)],
        x_scale=0.01,
        diff_step=1e-3,
    )
    numbers = numbers_of(solution.x)
    return ResponseFit(
        gain=gain_of(readings.predicted(numbers)),
        delay_s=numbers[0],
        lag_s=numbers[1],
        gain_sd=0.0,
        delay_sd_s=0.0,
        lag_sd_s=0.0,
        residual=float(np.std(solution.fun) / np.std(measured)),
        seconds=len(blocks) * TURNS.block_s,
        contact=ContactSpring(*numbers[2:]) if start[2] > 0.0 else None,
    )


def _without_trend(t_s: Array, values: Array) -> Array:
    columns = np.column_stack((np.ones(len(t_s)), t_s - t_s.mean()))
    trend, *_ = np.linalg.lstsq(columns, values, rcond=None)
    residuals: Array = values - columns @ trend
    return residuals
