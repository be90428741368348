"""Where the turn of the rover comes from: its gyro or its wheels."""

from collections.abc import Sequence
from typing import NamedTuple

from controllers.estimation.filter.transition import Turn
from controllers.estimation.gyro.gyro_noise import GyroNoise
from controllers.estimation.gyro.integrator import GyroIntegrator, GyroTurn
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn
from controllers.motion.body_motion import BodyMotion


class GyroEvidence(NamedTuple):
    """What the gyro offers the stop rules as evidence.

    Attributes:
        turn: Turn of the rover by gyro and by wheels in this cycle; None where one did not measure it.
        rejected_rad_s: Newest reading if the rover cannot turn that fast; else None.
    """

    turn: TurnEvidence | None = None
    rejected_rad_s: float | None = None


class TurnSource:
    """Chooses between gyro and wheels.

    While the gyro is fresh but has no new reading since the last increment, the wheels' turn is held
    back: it is not lost if the gyro fails, and not counted twice if it has a reading. The turn in a gap
    between the gyro's readings is that of the wheels. At standstill the wheels are used: the gyro would
    only add its noise.

    Args:
        gyro: Integrates the readings.
        noise: Of the gyro.
        wheel_count: Number of wheels.

    Attributes:
        yaw_source: Of the last turn.
        turn: Turn of the last cycle by gyro and by wheels; None where one of them did not measure it.
        has_lost_motion: Whether the wheels have lost a part of the turn that waits.
    """

    def __init__(self, gyro: GyroIntegrator, noise: GyroNoise, wheel_count: int) -> None:
        self._gyro, self._noise = gyro, noise
        self._turn_rad = 0.0
        self._wheels = WheelTurn()
        self._parts_rad = (0.0,) * wheel_count
        self.has_lost_motion = False
        self.yaw_source = YawSource.WHEELS
        self.turn: TurnEvidence | None = None

    @property
    def evidence(self) -> GyroEvidence:
        """What the stop rules see of the gyro in this cycle."""
        return GyroEvidence(self.turn, self._gyro.rejected_rad_s)

    def add(self, effects: Sequence[BodyMotion], increment: BodyIncrement) -> None:
        """Add the turn of the wheels; `effects` are those of a radian of each on the body."""
        self._wheels = self._wheels.with_increment(effects, increment.turned_rad, increment.duration_s)
        self._parts_rad = tuple(
            part_rad + effect[2] * turned_rad
            for part_rad, effect, turned_rad in zip(
                self._parts_rad, effects, increment.turned_rad, strict=True
            )
        )
        self._turn_rad += increment.turn_rad

    def take(self, now_ns: int, bias_rad_s: float, *, is_still: bool) -> Turn:
        """Return the turn since the last call."""
        by_gyro = self._gyro.take()
        if not is_still and by_gyro.covered_s > 0.0:
            return self._by_gyro(by_gyro, bias_rad_s)
        if not is_still and self._gyro.is_fresh(now_ns):
            return Turn(angle_rad=0.0, source=YawSource.GYRO)
        self.yaw_source = YawSource.WHEELS
        turn = Turn(angle_rad=self._turn_rad, source=YawSource.WHEELS, measured_s=self._wheels.duration_s)
        self._begin()
        return turn

    def waiting(self, bias_rad_s: float, *, is_at_standstill: bool) -> tuple[float, float]:
        """Return the turn that waits for motion of the wheels or a reading of the gyro, and its variance."""
        if is_at_standstill or self.yaw_source is not YawSource.GYRO:
            return 0.0, 0.0
        angle_rad, covered_s, variance_rad2 = self._gyro.turn
        if covered_s > 0.0:
            return angle_rad - bias_rad_s * covered_s, variance_rad2
        error_rad = ESTIMATION.pose.gap_turn_error * self._wheels.both_ways_rad
        return self._turn_rad, error_rad**2 / 3.0

    def _by_gyro(self, by_gyro: GyroTurn, bias_rad_s: float) -> Turn:
        angle_rad, covered_s, unobserved_rad2 = by_gyro
        self.yaw_source = YawSource.GYRO
        wheels, wheel_turn_rad, has_gap = self._wheels, self._turn_rad, self._gyro.has_gap
        parts_rad, has_lost_motion = self._parts_rad, self.has_lost_motion
        self._begin()
        if has_gap or has_lost_motion:
            self._noise.interrupt()
        bias_rad = bias_rad_s * covered_s
        unobserved_rad2 += self._noise.add(angle_rad - bias_rad, covered_s, unobserved_rad2, wheels)
        if has_gap:
            gap_share = max(0.0, 1.0 - covered_s / wheels.duration_s)
            by_wheels_rad = wheel_turn_rad * gap_share
            return Turn(
                angle_rad=angle_rad + by_wheels_rad,
                source=YawSource.GYRO,
                covered_s=covered_s,
                by_wheels_rad=by_wheels_rad,
                gap_error_rad=ESTIMATION.pose.gap_turn_error * wheels.both_ways_rad * gap_share,
                unobserved_rad2=unobserved_rad2,
                measured_s=max(covered_s, wheels.duration_s),
            )
        if not has_lost_motion:
            self.turn = TurnEvidence(gyro_rad=angle_rad - bias_rad, wheels=wheels, by_wheel_rad=parts_rad)
        return Turn(
            angle_rad=angle_rad,
            source=YawSource.GYRO,
            covered_s=covered_s,
            unobserved_rad2=unobserved_rad2,
            measured_s=covered_s,
        )

    def _begin(self) -> None:
        self._turn_rad = 0.0
        self._wheels = WheelTurn()
        self._parts_rad = (0.0,) * len(self._parts_rad)
        self.has_lost_motion = False
        self._gyro.clear_gap()
