"""Numbers over time, and poses over time in the local frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from controllers.estimation.parameters import ESTIMATION
from rover_hil.drives.arrays import Array

DISTANCE_STEP_M = 0.02
FIRST_MOTION_M = 0.002
FIRST_MOTION_RAD = 0.005
SLIP_WINDOW_S = 2.0
SLIP_LEAST_M = 0.02
SPEED_WINDOW_S = 0.1
MEAN_WINDOW_S = 0.5


@dataclass(frozen=True, slots=True)
class Series:
    """Values over time since the start of the run in s; times increase."""

    t_s: Array
    value: Array

    @classmethod
    def of(cls, rows: Sequence[Sequence[float]] | Array) -> Self:
        """Take (time, value) rows; those not finite, or not newer than all before, are left out."""
        table = finite_rows(rows, 2)
        newest_before = np.concatenate(([-np.inf], np.maximum.accumulate(table[:, 0])))[:-1]
        table = table[table[:, 0] > newest_before]
        return cls(table[:, 0], table[:, 1])


@dataclass(frozen=True, slots=True)
class Track:
    """Poses over time since the start of the run in s: m, m, rad; the yaw is not wrapped, NaN without one."""

    t_s: Array
    x_m: Array
    y_m: Array
    yaw_rad: Array

    @property
    def has_yaw(self) -> bool:
        """Whether a yaw is known."""
        return bool(np.isfinite(self.yaw_rad).any())

    @classmethod
    def of(cls, rows: Array) -> Self:
        """Take rows (t_s, x_m, y_m, yaw_rad, ...), all finite, yaw wrapped or not."""
        return cls(rows[:, 0], rows[:, 1], rows[:, 2], np.unwrap(rows[:, 3]))

    def at(self, t_s: Array) -> "Track":
        """Return the poses at other times, interpolated; NaN before the first and after the last."""
        x_m, y_m, yaw_rad = (
            np.interp(t_s, self.t_s, values, left=np.nan, right=np.nan)
            for values in (self.x_m, self.y_m, self.yaw_rad)
        )
        return Track(t_s, x_m, y_m, yaw_rad)

    def from_first_pose(self) -> "Track":
        """Return the track as seen from its own first pose."""
        cosine, sine = np.cos(self.yaw_rad[0]), np.sin(self.yaw_rad[0])
        x_m, y_m = self.x_m - self.x_m[0], self.y_m - self.y_m[0]
        return Track(
            self.t_s, cosine * x_m + sine * y_m, cosine * y_m - sine * x_m, self.yaw_rad - self.yaw_rad[0]
        )

    def aligned_with(self, other: "Track") -> "Track":
        """Return the positions turned and moved to fit another track best, without a yaw.

        The least squares of positions at common times, as `evo` aligns; without two of them, unchanged.
        """
        at = other.at(self.t_s)
        known = np.isfinite(at.x_m)
        own, fitted = self.x_m + 1j * self.y_m, at.x_m + 1j * at.y_m
        if known.sum() > 1:
            middle, towards = own[known].mean(), fitted[known].mean()
            product = np.vdot(own[known] - middle, fitted[known] - towards)
            own = towards + (own - middle) * np.exp(1j * np.angle(product))
        return Track(self.t_s, own.real, own.imag, np.full(len(self.t_s), np.nan))

    def distance_m(self) -> Array:
        """Return the distance driven up to each pose.

        Counted from points at least `DISTANCE_STEP_M` apart: at standstill, and between closer points, noise
        would add up to a distance that was not driven.
        """
        kept, lengths = [0], [0.0]
        for index in range(1, len(self.t_s)):
            step_m = np.hypot(self.x_m[index] - self.x_m[kept[-1]], self.y_m[index] - self.y_m[kept[-1]])
            if step_m >= DISTANCE_STEP_M or index == len(self.t_s) - 1:
                kept.append(index)
                lengths.append(lengths[-1] + float(step_m))
        return np.interp(np.arange(len(self.t_s)), kept, lengths)

    def first_motion_s(self) -> float:
        """Return when the first motion began; the last time when there was none."""
        moved = np.hypot(self.x_m - self.x_m[0], self.y_m - self.y_m[0]) > FIRST_MOTION_M
        moved |= np.abs(self.yaw_rad - self.yaw_rad[0]) > FIRST_MOTION_RAD
        return float(self.t_s[np.argmax(moved)] if moved.any() else self.t_s[-1])


def finite_rows(rows: Sequence[Sequence[float]] | Array, width: int) -> Array:
    """Return the rows that hold finite numbers only, as an array of shape (n, width)."""
    table = np.array(rows, dtype=np.float64).reshape(-1, width)
    return table[np.isfinite(table).all(axis=1)]


def slip_over_time(encoders: Track, truth: Track) -> Series:
    """Return 1 - true distance / encoder distance in a sliding window; NaN where nothing moved."""
    t_s, half_s = truth.t_s, 0.5 * SLIP_WINDOW_S
    distances = ((encoders.t_s, encoders.distance_m()), (truth.t_s, truth.distance_m()))
    encoder_m, true_m = (
        np.interp(t_s + half_s, at_s, driven_m) - np.interp(t_s - half_s, at_s, driven_m)
        for at_s, driven_m in distances
    )
    moved = encoder_m >= SLIP_LEAST_M
    return Series(t_s, np.where(moved, 1.0 - true_m / np.where(moved, encoder_m, 1.0), np.nan))


def running_mean(series: Series) -> Series:
    """Return the mean over `MEAN_WINDOW_S` around each time; NaN counts for nothing and stays NaN."""
    if len(series.t_s) < 2:
        return series
    period_s = float(np.median(np.diff(series.t_s)))
    window = np.ones(min(len(series.t_s), max(1, round(MEAN_WINDOW_S / period_s))))
    known = np.isfinite(series.value)
    total = np.convolve(np.where(known, series.value, 0.0), window, mode="same")
    count = np.convolve(known.astype(float), window, mode="same")
    return Series(series.t_s, np.where(known, total / np.maximum(count, 1.0), np.nan))


def local_headings(heading: Series, first_motion_s: float) -> Series:
    """Turn headings by their mean before the first motion, when the local yaw is zero."""
    at_rest = heading.t_s <= max(first_motion_s, float(heading.t_s[0]))
    offset_rad = float(np.angle(np.exp(1j * heading.value[at_rest]).mean()))
    yaw_rad = np.unwrap(heading.value - offset_rad)
    return Series(heading.t_s, yaw_rad - np.round(yaw_rad[0] / (2 * np.pi)) * 2 * np.pi)


def integrate_rate(rate: Series, first_motion_s: float) -> Series:
    """Return the angle turned, after taking the mean rate before the first motion off as the bias."""
    at_rest = rate.t_s <= first_motion_s
    value = rate.value - (rate.value[at_rest].mean() if at_rest.any() else 0.0)
    steps_rad = 0.5 * (value[1:] + value[:-1]) * np.diff(rate.t_s)
    return Series(rate.t_s, np.concatenate(([0.0], np.cumsum(steps_rad))))


def speed_from_positions(position: Series, limit_rad_s: float) -> Series:
    """Return speeds over about `SPEED_WINDOW_S`.

    NaN where nothing was received for long, and around steps that no wheel of this speed limit can make.
    """
    if len(position.t_s) < 2:
        return Series(position.t_s[:0], position.value[:0])
    steps_s, steps_rad = np.diff(position.t_s), np.diff(position.value)
    width = min(len(steps_s), max(1, round(SPEED_WINDOW_S / float(np.median(steps_s)))))
    tuned = ESTIMATION.odometry
    jumps = np.abs(steps_rad) > tuned.plausible_speed * limit_rad_s * (steps_s + tuned.arrival_jitter_s)
    jumps_before = np.concatenate(([0], np.cumsum(jumps)))
    elapsed_s = position.t_s[width:] - position.t_s[:-width]
    turned_rad = position.value[width:] - position.value[:-width]
    is_known = elapsed_s <= 2.0 * np.median(elapsed_s)
    is_known &= jumps_before[width:] == jumps_before[:-width]
    middle_s = 0.5 * (position.t_s[width:] + position.t_s[:-width])
    return Series(middle_s, np.where(is_known, turned_rad / elapsed_s, np.nan))


def spans(t_s: Array, keys: Sequence[str]) -> list[tuple[float, float, str]]:
    """Return (start, end, key) of each stretch of equal keys; it lasts until the next one starts."""
    starts = [index for index, key in enumerate(keys) if index == 0 or key != keys[index - 1]]
    edges = [*(float(t_s[index]) for index in starts), float(t_s[-1])]
    return [
        (start_s, end_s, keys[index])
        for start_s, end_s, index in zip(edges[:-1], edges[1:], starts, strict=True)
    ]
