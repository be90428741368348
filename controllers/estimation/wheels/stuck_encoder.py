"""A wheel that stays while the gyro contradicts the turn by the others: a dead encoder, or a drag."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.estimation.wheels.turn_evidence import TurnEvidence
from controllers.fault import Bound, Cause, Fault, Severity
from controllers.motion.body_motion import BodyMotion


@dataclass(slots=True)
class _Stay:
    """What has happened since a wheel stays.

    Attributes:
        turned_rad: Its own angle.
        others_rad: Greatest angle of another wheel.
        missing_rad: Turn by the gyro less that by the wheels.
        noise_rad2: Variance of that without the bias.
    """

    turned_rad: float = 0.0
    others_rad: float = 0.0
    duration_s: float = 0.0
    missing_rad: float = 0.0
    noise_rad2: float = 0.0


class StuckEncoders:
    """Finds wheels that stay while others turn, where the gyro does not confirm it.

    Around a wheel that really stays the rover turns, and the gyro measures it. A turn that is missing by more
    than the noise of [filter] explains is that of the wheel that stays: its angle is then unknown by the
    missing turn over the turn per radian of the wheel.

    Args:
        settings: Noise of the turns.
        count: Number of wheels.
    """

    def __init__(self, settings: FilterSettings, count: int) -> None:
        self._settings = settings
        self._deviate = NormalDist().inv_cdf(0.5 * (1.0 + settings.gate_probability))
        self._stays = [_Stay() for _ in range(count)]

    def note(self, turned_rad: Sequence[float]) -> None:
        """Take the angles of one increment."""
        greatest_rad = max(map(abs, turned_rad))
        for wheel, turned in enumerate(turned_rad):
            stay = self._stays[wheel]
            if abs(stay.turned_rad + turned) > ESTIMATION.odometry.still_rad:
                self._stays[wheel] = _Stay()
                continue
            stay.turned_rad += turned
            stay.others_rad += greatest_rad

    def find(
        self,
        increment: BodyIncrement,
        evidence: TurnEvidence,
        effects: Sequence[BodyMotion],
        bias_rad2_s2: float,
    ) -> Fault | None:
        """Return the fault of the wheels that stay: by how much their angles are unknown since then.

        Args:
            increment: Motion of the wheels.
            evidence: Turn of the same interval by gyro and wheels.
            effects: Motion of the body per radian of each wheel.
            bias_rad2_s2: Variance of the gyro's bias.
        """
        unknown_rad = self._unknown_rad(
            evidence, math.hypot(increment.x_m, increment.y_m), effects, bias_rad2_s2
        )
        stuck = ", ".join(str(wheel) for wheel, unknown in enumerate(unknown_rad) if unknown)
        if not stuck:
            return None
        text = (
            f"wheel {stuck} does not turn, but the gyro contradicts the turn by the others; "
            "the estimate is wider"
        )
        return Fault(stuck, Cause.STUCK_ENCODER, text, Severity.UNCERTAIN, Bound(wheel_rad=unknown_rad))

    def _unknown_rad(
        self, evidence: TurnEvidence, distance_m: float, effects: Sequence[BodyMotion], bias_rad2_s2: float
    ) -> tuple[float, ...]:
        """Return by how much each angle is unknown, signed, since the wheel stays; 0 where it is known."""
        settings, wheels = self._settings, evidence.wheels
        noise_rad2 = (
            settings.wheel_yaw_noise_rad_sqrt_rad**2 * abs(wheels.turn_rad)
            + settings.wheel_yaw_noise_rad_sqrt_m**2 * distance_m
            + settings.gyro_noise_rad_sqrt_s**2 * wheels.duration_s
        )
        for stay in self._stays:
            stay.duration_s += wheels.duration_s
            stay.missing_rad += evidence.gyro_rad - wheels.turn_rad
            stay.noise_rad2 += noise_rad2
        if all(map(self._is_long, self._stays)):
            return (0.0,) * len(self._stays)  # a standstill: `StandstillWatch` compares it with the gyro
        return tuple(
            stay.missing_rad / effect[2] if self._is_contradicted(stay, effect, bias_rad2_s2) else 0.0
            for stay, effect in zip(self._stays, effects, strict=True)
        )

    def _is_long(self, stay: _Stay) -> bool:
        return stay.duration_s >= self._settings.standstill_s

    def _is_contradicted(self, stay: _Stay, effect: BodyMotion, bias_rad2_s2: float) -> bool:
        if not self._is_long(stay) or stay.others_rad <= ESTIMATION.odometry.still_rad:
            return False
        sd_rad = math.sqrt(stay.noise_rad2 + bias_rad2_s2 * stay.duration_s**2)
        return effect[2] != 0.0 and abs(stay.missing_rad) > self._deviate * sd_rad
