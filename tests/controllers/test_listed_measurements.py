"""A measurement that nobody has thought of: a file like `BearingReader`, and an entry in `make_readers`."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.measurement_model import Array, Expected, Measured
from controllers.estimation.filter.reader import Situation
from controllers.estimation.filter.state_layout import YAW, X, Y
from controllers.estimation.listed import make_readers
from controllers.estimation.settings import FilterSettings
from controllers.estimator import Estimator
from controllers.motion.kinematics import SkidSteerKinematics
from controllers.motion.rover_geometry import SkidSteerRoverSettings
from controllers.roles import DeviceRoles
from drivers.record import record
from drivers.samples import Sample, WheelSample

BEACON_M = complex(3.0, 4.0)
SD_RAD = 0.01


@record(frozen=True, slots=True, kw_only=True)
class BearingSample(Sample):
    """Direction to a beacon in the body frame."""

    bearing_rad: float


@dataclass(frozen=True, slots=True)
class Bearing:
    """b = atan2(y_b - y, x_b - x) - yaw."""

    names: tuple[Measured, ...] = (Measured("beacon", "bearing"),)
    angles: tuple[int, ...] = (0,)

    def predict(self, state: Array) -> Expected:
        ahead_m, aside_m = BEACON_M.real - state.item(X), BEACON_M.imag - state.item(Y)
        square_m2 = ahead_m**2 + aside_m**2
        row = np.zeros((1, len(state)))
        row[0, [X, Y, YAW]] = aside_m / square_m2, -ahead_m / square_m2, -1.0
        return Expected(
            np.array([math.atan2(aside_m, ahead_m) - state.item(YAW)]), row, np.array([SD_RAD**2])
        )


class BearingReader:
    kind: ClassVar[type[Sample]] = BearingSample

    def source(self, sample: BearingSample) -> str:
        return sample.device

    def measured_ns(self, sample: BearingSample, t_ns: int) -> int:
        return t_ns

    def correct(self, sample: BearingSample, now: Situation) -> tuple[Innovation, ...]:
        return now.pose_filter.correct(Bearing(), (sample.bearing_rad,))

    def miss(self, sample: BearingSample) -> None:
        pass


def yaw_sd_rad(*, hears_beacon: bool) -> tuple[float, list[str]]:
    """Return the deviation of the yaw after driving, and what has corrected the estimate."""
    rover = SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.1, track_m=0.5)
    estimator = Estimator(
        SkidSteerKinematics(rover), FilterSettings(), 20.0, DeviceRoles(wheels="wheels", required={})
    )
    names: list[str] = []
    for step in range(100):
        t_ns = (step + 1) * 20_000_000
        for wheel in range(4):
            sample = WheelSample(device="wheels", t_ns=t_ns, wheel=wheel, position_rad=0.1 * step)
            estimator.take(sample, t_ns)
        if hears_beacon:
            bearing_rad = math.atan2(BEACON_M.imag, BEACON_M.real - 0.01 * step)
            estimator.take(BearingSample(device="beacon", t_ns=t_ns, bearing_rad=bearing_rad), t_ns)
        names += [innovation.name for innovation in estimator.advance(t_ns) if innovation.accepted]
    return math.sqrt(estimator.estimate(t_ns).covariance[5]), names


def test_a_measurement_is_a_reader_and_a_line_in_the_list(monkeypatch: pytest.MonkeyPatch) -> None:
    alone_rad, _ = yaw_sd_rad(hears_beacon=True)
    monkeypatch.setattr(
        "controllers.estimator.make_readers", lambda *parts: (*make_readers(*parts), BearingReader())
    )
    unheard_rad, none = yaw_sd_rad(hears_beacon=False)
    heard_rad, names = yaw_sd_rad(hears_beacon=True)
    assert unheard_rad == alone_rad
    assert not none
    assert heard_rad < 0.9 * alone_rad
    assert len(names) > 90
