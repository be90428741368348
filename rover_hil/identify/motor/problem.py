"""Residuals between the log of a motor and a model of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.record import MotorSignals, Moves, find_moves
from rover_hil.identify.motor.response import Motion, MotorModel, Response, respond
from rover_hil.identify.motor.sensing import CurrentSensor
from rover_hil.report.tracks import Series

MEDIAN_TO_DEVIATION = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Standard deviations of the residuals: rad or rad/s, A, V; and the ripple of the current at 1 A."""

    motion: float = 1.0
    current_a: float = 0.1
    voltage_v: float = 0.1
    ripple_a: float = 0.16


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Measured minus expected, not weighted, by channel, with the times they belong to."""

    motion: Array
    current: Array
    voltage: Array

    def weighted(self, noise: Noise) -> Array:
        """Return everything in standard deviations.

        Currents and voltages beyond the trusted range are drawn in; their squares are the soft-L1 loss: a
        sample at the very moment of a jump, where inductance matters, must not outweigh hundreds of others.
        """
        electric = np.concatenate((self.current / noise.current_a, self.voltage / noise.voltage_v))
        drawn_in = (
            np.sign(electric)
            * MOTOR_FIT.fit.trusted
            * np.sqrt(2 * np.sqrt(1 + (electric / MOTOR_FIT.fit.trusted) ** 2) - 2)
        )
        return np.concatenate((self.motion / noise.motion, drawn_in))


class RecordProblem:
    """One log of one motor.

    Args:
        record: What was measured.

    Attributes:
        moves: The setpoint, reduced to its changes.
        uses_ticks: Motion is compared in turned angle between samples; else in reported speed.
        t_s: Time of each residual: motion, current, voltage.
        period_s: Median time between two samples of the motion.
    """

    def __init__(self, record: MotorSignals) -> None:
        self.record = record
        self.moves: Moves = find_moves(record.set_point)
        self.uses_ticks = _positions_agree(record)
        motion = record.position if self.uses_ticks else record.speed
        if motion is None:
            raise LogError(
                f"{record.log}: neither positions nor speeds of motor {record.motor}: use another drive"
            )
        self._motion = motion
        voltage = record.voltage or Series(np.empty(0), np.empty(0))
        self._voltage = voltage
        steps_s = np.diff(motion.t_s)
        self.period_s = float(np.median(steps_s))
        self._keep = steps_s < MOTOR_FIT.record.longest_gap_s
        motion_s = motion.t_s[1:][self._keep] if self.uses_ticks else motion.t_s
        self.t_s = np.concatenate((motion_s, record.current.t_s, voltage.t_s))
        self._motion_step_s = steps_s[self._keep] if self.uses_ticks else np.ones(motion.t_s.size)
        self.first_speed = self._measured_first_speed()
        self._times_s = (motion_s, record.current.t_s, voltage.t_s)
        self._counts: list[Array] = []
        self.show_changes()

    def show_changes(self) -> None:
        """Compare everything."""
        self._counts = [np.ones(t_s.size) for t_s in self._times_s]

    def hide_changes(self, delay_s: Array, margin_s: float) -> None:
        """Compare nothing this close to an arriving change of the setpoint."""
        arrival_s = np.sort(self.moves.t_s + delay_s[self.moves.move])
        self._counts = []
        for t_s in self._times_s:
            last = np.searchsorted(arrival_s, t_s + margin_s, side="right") - 1
            is_near = (last >= 0) & (t_s <= arrival_s[np.maximum(last, 0)] + margin_s)
            self._counts.append(np.where(is_near, 0.0, 1.0))

    def counted(self) -> tuple[float, float, float]:
        """Return how many samples of motion, current and voltage are compared."""
        motion, current, voltage = (float(counts.sum()) for counts in self._counts)
        return motion, current, voltage

    def motion_speed(self) -> tuple[Array, Array]:
        """Return times and measured speeds, from ticks where they are used."""
        motion = self._motion
        if not self.uses_ticks:
            return motion.t_s, motion.value
        speed = (np.diff(motion.value) / np.diff(motion.t_s))[self._keep]
        return motion.t_s[1:][self._keep], speed

    def respond(self, model: MotorModel, delay_s: Array) -> Response:
        """Return the model's answer to this log's setpoints."""
        return respond(model, self.moves, delay_s, self.first_speed)

    def residuals(self, model: MotorModel, delay_s: Array, sensor: CurrentSensor) -> Residuals:
        """Return measured minus expected."""
        response = self.respond(model, delay_s)
        moved = response.at(self._motion.t_s)
        if self.uses_ticks:
            motion = np.diff(self._motion.value - moved.position)[self._keep]
        else:
            motion = self._motion.value - moved.speed
        expected_a = sensor.expected(response.current_a(self._electric(response, moved, self.record.current)))
        current = self.record.current.value - expected_a
        voltage_v = response.voltage_v(self._electric(response, moved, self._voltage))
        voltage = self._voltage.value - voltage_v
        return Residuals(
            *(part * counts for part, counts in zip((motion, current, voltage), self._counts, strict=True))
        )

    def speed_residuals(self, residuals: Residuals) -> Array:
        """Return the motion's residuals in rad/s."""
        return residuals.motion / self._motion_step_s

    def expected_current(self, model: MotorModel, delay_s: Array) -> Array:
        """Return the model's current at each current sample, signed."""
        response = self.respond(model, delay_s)
        return response.current_a(response.at(self.record.current.t_s))

    def _electric(self, response: Response, moved: Motion, series: Series) -> Motion:
        """Return the motion at a series' times; most logs take everything at the same ones."""
        same = series.t_s.size == self._motion.t_s.size and np.array_equal(series.t_s, self._motion.t_s)
        return moved if same else response.at(series.t_s)

    def _measured_first_speed(self) -> float:
        _, speed = self.motion_speed()
        return float(np.median(speed[: MOTOR_FIT.record.first_samples]))


class MotorProblem:
    """All logs of one motor.

    Args:
        records: At least one; all of the same device.

    Attributes:
        owner: For every residual the index of its move, counted over all logs.
        t_s: For every residual its time, the logs one after another.
        moves: Number of moves in all logs.
        noise: Weights; replaced when the fit knows better.
    """

    def __init__(self, records: Sequence[MotorSignals]) -> None:
        self.parts = [RecordProblem(record) for record in records]
        counts = [part.moves.start_s.size for part in self.parts]
        self._first_move = np.r_[0, np.cumsum(counts)]
        self.moves = int(self._first_move[-1])
        self.owner: NDArray[np.intp] = np.concatenate(
            [
                first + np.maximum(np.searchsorted(part.moves.start_s, part.t_s, side="right") - 1, 0)
                for first, part in zip(self._first_move, self.parts, strict=False)
            ]
        )
        self.has_voltage = all(part.record.voltage is not None for part in self.parts)
        self.noise = Noise()
        self._sensors: dict[float, CurrentSensor] = {}

    @property
    def period_s(self) -> float:
        """Longest median time between two samples of the motion in any log."""
        return max(part.period_s for part in self.parts)

    def show_changes(self) -> None:
        """Compare everything."""
        for part in self.parts:
            part.show_changes()

    def hide_changes(self, delay_s: Array, margin_s: float) -> None:
        """Compare nothing this close to an arriving change of the setpoint."""
        for first, part in zip(self._first_move, self.parts, strict=False):
            part.hide_changes(delay_s[first : first + part.moves.start_s.size], margin_s)

    def residuals(self, model: MotorModel, delay_s: Array) -> list[Residuals]:
        """Return measured minus expected of every log."""
        sensor = self._sensor()
        return [
            part.residuals(model, delay_s[first : first + part.moves.start_s.size], sensor)
            for first, part in zip(self._first_move, self.parts, strict=False)
        ]

    def weighted(self, model: MotorModel, delay_s: Array) -> Array:
        """Return all residuals in standard deviations."""
        return np.concatenate([item.weighted(self.noise) for item in self.residuals(model, delay_s)])

    def learn_noise(self, model: MotorModel, delay_s: Array) -> None:
        """Take the noise from the residuals of a fit."""
        items = self.residuals(model, delay_s)
        currents_a = np.concatenate(
            [
                np.abs(part.expected_current(model, delay_s[first : first + part.moves.start_s.size]))
                for first, part in zip(self._first_move, self.parts, strict=False)
            ]
        )
        motion = np.concatenate([item.motion for item in items])
        counted = sum(part.counted()[0] for part in self.parts)
        current = np.concatenate([item.current for item in items])
        flows = currents_a > 0.25 * model.coulomb_a
        self.noise = replace(
            self.noise,
            motion=max(float(np.sqrt(np.sum(motion**2) / max(counted, 1.0))), 1e-6),
            # Medians resist the few samples in which the motor starts or stops.
            current_a=_deviation(current[flows], 1e-3),
            voltage_v=_deviation(np.concatenate([item.voltage for item in items]), 1e-4),
            ripple_a=_deviation(current[flows] / np.sqrt(np.maximum(currents_a[flows], 0.01)), 1e-3),
        )

    def costs(self, weighted: Array) -> Array:
        """Return the sum of squares of each move."""
        return np.asarray(np.bincount(self.owner, weighted**2, self.moves), np.float64)

    def _sensor(self) -> CurrentSensor:
        ripple = round(self.noise.ripple_a, 3)
        if ripple not in self._sensors:
            record = self.parts[0].record
            self._sensors = {ripple: CurrentSensor(record.scale, record.current_is_signed, ripple)}
        return self._sensors[ripple]


def _deviation(values: Array, least: float) -> float:
    return max(MEDIAN_TO_DEVIATION * float(np.median(np.abs(values))), least) if values.size else least


def _positions_agree(record: MotorSignals) -> bool:
    """Return whether the positions turn as far as the reported speeds."""
    position, speed = record.position, record.speed
    if position is None or speed is None:
        return position is not None
    turned = float(np.abs(np.diff(position.value)).sum())
    expected = float(np.sum(np.abs(speed.value[1:]) * np.diff(speed.t_s)))
    return (
        abs(turned - expected) <= MOTOR_FIT.record.disagreement * expected + MOTOR_FIT.record.disagreement_rad
    )
