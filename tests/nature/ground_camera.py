"""A camera that sees the ground move, without pictures: the true motion between two frames with errors.

It stands for rendered pictures where many missions are driven. Errors: of a pair of frames; a factor of the
travel, the same for a whole drive (height and pitch of the camera, focal length, sinkage); a factor that
drifts with the travel (relief, shadows); pairs that measure nothing, in bursts. Each frame is located against
one before: of a rover that stands the errors of pairs do not add up. It knows nothing of any estimator.
"""

import cmath
import math
from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from controllers.ground_motion.motion import GroundMotion
from drivers.samples import FrameSample

DEVICE = "ground camera"
NO_PICTURE = np.zeros((1, 1), np.uint8)


class Place(Protocol):
    """Where a rover is."""

    @property
    def x_m(self) -> float:
        """World frame."""
        ...

    @property
    def y_m(self) -> float:
        """World frame."""
        ...

    @property
    def yaw_rad(self) -> float:
        """Counter-clockwise, not wrapped."""
        ...


class Rover(Protocol):
    """What the camera is mounted on."""

    def truth(self) -> Place:
        """Return the state at the time reached."""
        ...


@dataclass(frozen=True, kw_only=True)
class CameraErrors:
    """Errors of the camera, and what it reports of them.

    Attributes:
        place_sd_m: Of the place of a frame, forward; to the left half as much again.
        share_sd: Of the travel of a pair, over itself, in any direction.
        told_sd_m: What it reports of a pair, forward; to the left half as much again.
        turn_sd_rad: Of the turn of a pair, and what it reports of it.
        scale_sd: Of the factor of a drive.
        drift_sd: Of the factor that drifts, with a memory of `drift_m`.
        burst_probability: That a burst of pairs without a measurement begins with a frame.
        longest_burst: Greatest number of pairs in a burst.
        blind_m: From this distance from the start on to `sees_again_m` no pair is valid.
        period_ns: Between two exposures.
        delay_ns: From exposure to arrival.
    """

    place_sd_m: float = 7e-5
    share_sd: float = 0.005
    told_sd_m: float = 2e-4
    turn_sd_rad: float = 5e-4
    scale_sd: float = 0.015
    drift_sd: float = 0.005
    drift_m: float = 0.3
    burst_probability: float = 0.01
    longest_burst: int = 8
    blind_m: float = math.inf
    sees_again_m: float = math.inf
    period_ns: int = 100_000_000
    delay_ns: int = 60_000_000


@dataclass(frozen=True, slots=True)
class _Seen:
    place_m: complex
    yaw_rad: float


class GroundCamera:
    """Sends frames without content, and measures the motion between them.

    Args:
        rover: The camera looks at it whenever `frames` is called.
        rng: Source of the errors.
        errors: How it errs.
        point_m: Point of the rover whose motion it measures, forward and left.
    """

    def __init__(
        self,
        rover: Rover,
        rng: np.random.Generator,
        errors: CameraErrors | None = None,
        point_m: tuple[float, float] = (-0.25, 0.0),
    ) -> None:
        self._rover, self._rng = rover, rng
        self._errors = errors or CameraErrors()
        self.point_m = point_m
        self._scale = 1.0 + self._errors.scale_sd * float(rng.standard_normal())
        self._drift = 0.0
        self._place_m = 0j
        self._on_way: deque[FrameSample] = deque()
        self._seen: dict[int, _Seen] = {}
        self._newest_ns: int | None = None
        self._exposed_ns = 0
        self._index = 0
        self._blind_pairs = 0
        start = rover.truth()
        self._start_m = complex(start.x_m, start.y_m)

    @property
    def from_ns(self) -> int | None:
        """Time of the frame at which the next pair begins; None before the first."""
        return self._newest_ns

    def frames(self, now_ns: int) -> list[FrameSample]:
        """Expose a frame where one is due; return those that have arrived by now."""
        errors = self._errors
        if self._index == 0 or now_ns >= self._exposed_ns + errors.period_ns:
            truth = self._rover.truth()
            self._exposed_ns = now_ns
            self._seen[now_ns] = _Seen(complex(truth.x_m, truth.y_m), truth.yaw_rad)
            self._on_way.append(
                FrameSample(
                    device=DEVICE,
                    t_ns=now_ns + errors.delay_ns,
                    image=NO_PICTURE,
                    t_capture_ns=now_ns,
                    index=self._index,
                )
            )
            self._index += 1
        arrived = []
        while self._on_way and self._on_way[0].t_ns <= now_ns:
            arrived.append(self._on_way.popleft())
        return arrived

    def measure(self, frame: FrameSample, t_ns: int, prior: object) -> GroundMotion | None:
        """Return the motion since the frame before; None for the first one."""
        from_ns, self._newest_ns = self._newest_ns, t_ns
        if from_ns is None:
            return None
        before, now = self._seen.pop(from_ns), self._seen[t_ns]
        turn_rad = now.yaw_rad - before.yaw_rad
        point_m = complex(*self.point_m)
        travel_m = (now.place_m - before.place_m) * cmath.rect(1.0, -now.yaw_rad)
        travel_m += point_m * (1.0 - cmath.rect(1.0, -turn_rad))
        errors, noise = self._errors, self._rng.standard_normal(6)
        kept = math.exp(-abs(travel_m) / errors.drift_m)
        self._drift = kept * self._drift + math.sqrt(1.0 - kept**2) * errors.drift_sd * float(noise[3])
        measured_m = travel_m * (self._scale + self._drift)
        measured_m += errors.share_sd * abs(travel_m) * complex(noise[0], noise[1])
        before_m, self._place_m = self._place_m, errors.place_sd_m * complex(noise[4], 1.5 * noise[5])
        measured_m += self._place_m - before_m
        reason = self._invalid_because(now)
        return GroundMotion(
            from_ns=from_ns,
            to_ns=t_ns,
            point_m=self.point_m,
            foot_m=self.point_m,
            forward_m=0.0 if reason else measured_m.real,
            left_m=0.0 if reason else measured_m.imag,
            turn_rad=0.0 if reason else turn_rad + errors.turn_sd_rad * float(noise[2]),
            forward_sd_m=errors.told_sd_m,
            left_sd_m=1.5 * errors.told_sd_m,
            turn_sd_rad=errors.turn_sd_rad,
            scale_sd=math.hypot(errors.scale_sd, errors.drift_sd),
            direction_sd_rad=0.0,
            invalid_because=reason,
        )

    def _invalid_because(self, now: _Seen) -> str:
        errors = self._errors
        burst, length = self._rng.random(), int(self._rng.integers(1, errors.longest_burst + 1))
        if self._blind_pairs > 0:
            self._blind_pairs -= 1
        elif burst < errors.burst_probability:
            self._blind_pairs = length
        distance_m = abs(now.place_m - self._start_m)
        if self._blind_pairs or errors.blind_m <= distance_m < errors.sees_again_m:
            return "too few points move alike"
        return ""
