"""Tests while driving what is assumed about slip that nothing measures.

Each comparison is of two measurements of the same travel. Its residual r has the variance that the noise of
both and the assumed slip give it. For a normal residual of two components r^T V^-1 r exceeds k^2 with the
probability exp(-k^2 / 2); see `BEYOND_SD`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from controllers.estimation.ground.travel import GroundPair
from controllers.estimation.slip_compensator import SlipEvidence
from controllers.estimation.slip_prior import SlipPrior
from controllers.estimation.wheels.contradiction import ContradictionReport
from controllers.estimation.wheels.turn_evidence import TurnEvidence
from controllers.fault import Cause, Fault, Severity

FALSE_REPORT = 1e-5
"""Accepted probability that noise alone contradicts the assumption in one comparison: 1 % in a thousand."""
BEYOND_SD = math.sqrt(-2.0 * math.log(FALSE_REPORT))
"""A residual of so many standard deviations contradicts the assumption."""
WINDOW_M = 1.0
"""Travel of the wheels over which a camera, the gyro and the excitation are compared with them."""
GYRO_SCALE_SD = 0.01
"""Standard deviation of a gyro's scale: 1 %, as data sheets of microelectromechanical gyros state it."""


class TurnNoise(NamedTuple):
    """Errors of a rotation by the gyro.

    Attributes:
        noise_rad2: Variance by its noise; of successive rotations they add up.
        bias_rad: Standard deviation by its bias; of successive rotations these add up.
        late_rad: Standard deviation by the delay between gyro and wheels, at the end of the rotation.
    """

    noise_rad2: float
    bias_rad: float
    late_rad: float


class SlipAssumption:
    """Compares what is assumed about the ground with all that measures slip, and gives it up for good.

    Assumed in the comparisons: the noise of each sensor is as it states; the slips of the wheels are
    independent of each other; a rotation of wheels that do not skid follows their angles. The slip of all
    wheels alike on a straight path is seen by cameras, positions and the excitation only.

    Args:
        prior: What is assumed at the start.
        unknown: What is assumed from a contradiction on.
        share_sd: Part of the excitation's standard deviation that successive readings share.
        compares_turns: Whether the wheels show a rotation without skidding.

    Attributes:
        prior: What is assumed now.
        unknown: As given.
        fault: What has contradicted the assumption; None for nothing.
        path_m: Path on which only the assumption has given the slip, in the local frame.
    """

    def __init__(
        self, prior: SlipPrior, unknown: SlipPrior, *, share_sd: float = 1.0, compares_turns: bool = True
    ) -> None:
        self.prior, self.unknown = prior, unknown
        self._share_sd, self._compares_turns = share_sd, compares_turns
        self.fault: Fault | None = None
        self.path_m = 0j
        self._camera = _CameraWindow()
        self._turn = _TurnWindow()
        self._excited = _ExcitedWindow()

    @property
    def is_tested(self) -> bool:
        """Whether something is assumed that a sensor may contradict."""
        return self.prior != self.unknown

    def drive(self, way_m: complex) -> None:
        """Take a motion on which only the assumption gives the slip, in the local frame."""
        self.path_m += way_m

    def compare_ground(self, pairs: Sequence[GroundPair]) -> None:
        """Compare with motions over the ground that a camera has measured."""
        for pair in pairs if self.is_tested else ():
            if self._camera.length_m > WINDOW_M:
                self._camera = _CameraWindow()
            slip, deviations = self._camera.take(pair, self.prior)
            if deviations > BEYOND_SD:
                self._contradict("camera", f"the camera shows a slip of {100 * slip:.0f} %")

    def compare_turn(self, turn: TurnEvidence | None, noise: TurnNoise, rolled_m: float) -> None:
        """Compare a rotation by the gyro with that by the wheels.

        Args:
            turn: By both; None where one is missing.
            noise: Of that of the gyro.
            rolled_m: Travel of the wheels.
        """
        if not (self.is_tested and self._compares_turns) or turn is None:
            return
        if self._turn.length_m > WINDOW_M:
            self._turn = _TurnWindow()
        apart_rad, deviations = self._turn.take(turn, noise, rolled_m, self.prior)
        if deviations > BEYOND_SD:
            degrees = math.degrees(apart_rad)
            self._contradict("gyro", f"wheels and gyro differ by {degrees:.1f} deg within {WINDOW_M:g} m")

    def compare_positions(self, device: str, deviations: float, apart_m: float) -> None:
        """Compare with positions.

        Args:
            device: That measures them.
            deviations: Greatest difference of the travel by positions and by wheels, in standard deviations.
            apart_m: This difference.
        """
        if self.is_tested and deviations > BEYOND_SD:
            self._contradict(device, f"the travel by {device} and by wheels differ by {apart_m:.2f} m")

    def compare_slip(self, evidence: SlipEvidence, rolled_m: float) -> None:
        """Compare with the slip of an estimator, and with what else it has noticed."""
        if not self.is_tested:
            return
        symptom = evidence.lost_response or evidence.unusual_force
        if symptom:
            self._contradict("rover", symptom)
            return
        if self._excited.length_m > WINDOW_M:
            self._excited = _ExcitedWindow()
        slip, deviations = self._excited.take(evidence, rolled_m, self._share_sd, self.prior)
        if deviations > BEYOND_SD:
            self._contradict("rover", f"the yaw excitation shows a slip of {100 * slip:.0f} %")

    def compare_wheels(self, report: ContradictionReport | None) -> None:
        """Compare the wheels with each other; those that skid in rotations contradict each other there."""
        if self.is_tested and self._compares_turns and report is not None and report.wheel is not None:
            self._contradict("wheels", f"wheel {report.wheel} does not roll as the others do")

    def _contradict(self, source: str, text: str) -> None:
        if not self.is_tested:
            return
        text = (
            f'{text}: [ground] slip = "{self.prior.name}" does not hold here, from now on the slip counts '
            "as unknown"
        )
        self.fault = Fault(source, Cause.GROUND_ASSUMPTION, text, Severity.WARNING)
        self.prior = self.unknown


class _CameraWindow:
    """Travel by the camera and by the wheels in the same time, in the body frame."""

    def __init__(self) -> None:
        self._rolled_m = self._ground_m = 0j
        self.length_m = self._noise_m2 = 0.0

    def take(self, pair: GroundPair, prior: SlipPrior) -> tuple[float, float]:
        """Return slip and standard deviations of the window with one more pair."""
        self._rolled_m += pair.rolled_m
        self._ground_m += pair.ground_m
        self.length_m += abs(pair.rolled_m)
        self._noise_m2 += pair.sd_m**2
        if not self._rolled_m:
            return 0.0, 0.0
        share = self._ground_m / self._rolled_m
        noise2 = (self._noise_m2 + (prior.noise_m_sqrt_m or 0.0) ** 2 * self.length_m) / abs(
            self._rolled_m
        ) ** 2
        along2 = noise2 + prior.sd**2 + (abs(share) * pair.motion.scale_sd) ** 2
        across2 = noise2 + prior.cross_sd**2 + (abs(share) * pair.motion.direction_sd_rad) ** 2
        slip = 1.0 - share.real
        return slip, math.sqrt((slip - prior.mean) ** 2 / along2 + share.imag**2 / across2)


class _TurnWindow:
    """Rotation by the gyro and by the wheels in the same time."""

    def __init__(self) -> None:
        self.length_m = self._apart_rad = self._gyro_rad = self._noise_rad2 = self._bias_rad = 0.0
        self._by_wheel_rad: tuple[float, ...] = ()

    def take(
        self, turn: TurnEvidence, noise: TurnNoise, rolled_m: float, prior: SlipPrior
    ) -> tuple[float, float]:
        """Return difference and standard deviations of the window with one more rotation."""
        self.length_m += rolled_m
        self._apart_rad += turn.wheels.turn_rad - turn.gyro_rad
        self._gyro_rad += turn.gyro_rad
        self._noise_rad2 += noise.noise_rad2
        self._bias_rad += noise.bias_rad
        before_rad = self._by_wheel_rad or (0.0,) * len(turn.by_wheel_rad)
        self._by_wheel_rad = tuple(map(sum, zip(before_rad, turn.by_wheel_rad, strict=True)))
        wheels_rad2 = (prior.sd**2 + prior.mean**2) * sum(part_rad**2 for part_rad in self._by_wheel_rad)
        gyro_rad2 = self._noise_rad2 + self._bias_rad**2 + (GYRO_SCALE_SD * self._gyro_rad) ** 2
        variance = wheels_rad2 + gyro_rad2 + noise.late_rad**2
        return self._apart_rad, abs(self._apart_rad) / math.sqrt(variance) if variance else 0.0


class _ExcitedWindow:
    """Mean of the readings of a slip estimator over a travel."""

    def __init__(self) -> None:
        self.length_m = self._slip = self._variance = 0.0
        self._count = 0
        self._before: tuple[float, float] | None = None

    def take(
        self, evidence: SlipEvidence, rolled_m: float, share_sd: float, prior: SlipPrior
    ) -> tuple[float, float]:
        """Return mean slip and standard deviations of the window; 0 without a new valid reading."""
        self.length_m += rolled_m
        reading = None if evidence.slip is None else (evidence.slip, evidence.slip_sd)
        if reading is None or reading == self._before:
            return 0.0, 0.0
        self._before = reading
        slip, sd = reading
        self._count += 1
        self._slip += slip
        self._variance += sd**2
        mean, mean_sd2 = self._slip / self._count, self._variance / self._count
        shared2 = min(1.0, share_sd) ** 2
        variance = mean_sd2 * (shared2 + (1.0 - shared2) / self._count) + prior.sd**2
        return mean, abs(mean - prior.mean) / math.sqrt(variance)
