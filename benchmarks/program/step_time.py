"""How long one control cycle takes: four wheels, gyro, compass and the pose filter at 200 Hz.

    python -m benchmarks.program.step_time

prints JSON: median, 99th percentile and maximum in microseconds, the share of the 5 ms period, and the
same figures of a bare filterpy EKF (one predict and one update of the same size) measured in between.
Exit code 1 when the median is above 300 us or the 99th percentile above 1000 us.
"""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from controllers.control_loop import ControlLoop
from controllers.motion.rover_geometry import SkidSteerRoverSettings
from controllers.motion.settings import LimitSettings, WaypointsMission
from controllers.roles import DeviceRoles
from controllers.safety import Mode
from controllers.settings import ControlSettings
from drivers.clock import NANOSECONDS_PER_SECOND, stopwatch_ns
from drivers.samples import HeadingReference, HeadingSample, RateSample, Sample, WheelSample

STEPS = 20_000
WARM_UP_STEPS = 400
PERIOD_NS = 5_000_000
WHEEL_PERIOD_NS = 10_000_000
HEADING_PERIOD_NS = 20_000_000
START_NS = NANOSECONDS_PER_SECOND
STATES = 6
MEDIAN_BAR_US = 300.0
P99_BAR_US = 1000.0


@dataclass
class Course:
    """Wheel positions of a rover that obeys its setpoints at once, and its noisy sensors."""

    generator: np.random.Generator
    position_rad: list[float]
    yaw_rad: float = 0.0

    def samples(self, now_ns: int, speed_rad_s: tuple[float, ...]) -> list[Sample]:
        """Return what arrives in the cycle that ends at `now_ns`."""
        dt_s = PERIOD_NS / NANOSECONDS_PER_SECOND
        turn_rad_s = (speed_rad_s[1] - speed_rad_s[0]) * 0.1 / 0.5
        self.yaw_rad += turn_rad_s * dt_s
        arrived: list[Sample] = []
        for wheel, speed in enumerate(speed_rad_s):
            self.position_rad[wheel] += speed * dt_s
            # Two wheels in one cycle, two in the next, as on a shared bus.
            if (now_ns + wheel // 2 * PERIOD_NS) % WHEEL_PERIOD_NS == 0:
                arrived.append(
                    WheelSample(
                        device="wheels", t_ns=now_ns, wheel=wheel, position_rad=self.position_rad[wheel]
                    )
                )
        noise = self.generator.normal(0.0, 0.01, 2)
        arrived.append(RateSample(device="gyro", t_ns=now_ns, rate_z_rad_s=turn_rad_s + float(noise[0])))
        if now_ns % HEADING_PERIOD_NS == 0:
            arrived.append(
                HeadingSample(
                    device="compass",
                    t_ns=now_ns,
                    heading_rad=1.0 + self.yaw_rad + float(noise[1]),
                    reference=HeadingReference.MAGNETIC,
                )
            )
        return arrived


def make_loop() -> ControlLoop:
    """Return a controller whose mission does not end during the run."""
    settings = ControlSettings(
        rover=SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.1, track_m=0.5),
        limits=LimitSettings(wheel_speed_rad_s=20.0, wheel_acceleration_rad_s2=20.0),
        mission=WaypointsMission(
            type="waypoints", points=((400.0, 30.0), (400.0, 400.0)), speed_m_s=0.5, heading="along_path"
        ),
    )
    required = {"wheels": 0.15, "gyro": 0.15, "compass": 0.15}
    return ControlLoop(
        settings, DeviceRoles(wheels="wheels", gyro="gyro", headings=("compass",), required=required)
    )


def make_peer() -> Callable[[], None]:
    """Return one predict and one update of filterpy's EKF with as many states and no checks."""
    peer = ExtendedKalmanFilter(STATES, 1)
    peer.x = np.zeros(STATES)
    row = np.eye(STATES)[2:3]
    measured, variance = np.array([0.01]), np.array([[0.01]])

    def cycle() -> None:
        peer.predict()
        peer.update(measured, lambda _: row, lambda x: x[2:3], variance)

    return cycle


def figures(durations_ns: list[int]) -> dict[str, float]:
    """Return median, 99th percentile and maximum in microseconds."""
    durations_us = np.array(durations_ns) / 1000.0
    return {
        "median": round(float(np.median(durations_us)), 1),
        "p99": round(float(np.percentile(durations_us, 99)), 1),
        "max": round(float(durations_us.max()), 1),
    }


def measure() -> tuple[dict[str, float], dict[str, float]]:
    """Return the figures of the control cycle and of the peer, measured alternately."""
    loop, peer = make_loop(), make_peer()
    course = Course(np.random.default_rng(1), [0.0] * 4)
    speed_rad_s: tuple[float, ...] = (0.0,) * 4
    step_ns: list[int] = []
    peer_ns: list[int] = []
    for index in range(STEPS + WARM_UP_STEPS):
        now_ns = START_NS + index * PERIOD_NS
        samples = course.samples(now_ns, speed_rad_s)
        start_ns = stopwatch_ns()
        output = loop.step(now_ns, samples)
        middle_ns = stopwatch_ns()
        peer()
        end_ns = stopwatch_ns()
        speed_rad_s = output.command.speed_rad_s
        if index >= WARM_UP_STEPS:
            assert output.mode is Mode.RUNNING, output.reason
            step_ns.append(middle_ns - start_ns)
            peer_ns.append(end_ns - middle_ns)
    return figures(step_ns), figures(peer_ns)


def main() -> int:
    step_us, peer_us = measure()
    passed = step_us["median"] <= MEDIAN_BAR_US and step_us["p99"] <= P99_BAR_US
    report = {
        "steps": STEPS,
        "step_us": step_us,
        "median_share_of_period": round(step_us["median"] * 1000.0 / PERIOD_NS, 4),
        "peer": "filterpy ExtendedKalmanFilter, 6 states, one predict and one update",
        "peer_us": peer_us,
        "median_ratio_to_peer": round(step_us["median"] / peer_us["median"], 2),
        "bars_us": {"median": MEDIAN_BAR_US, "p99": P99_BAR_US},
        "passed": passed,
    }
    print(json.dumps(report, indent=2))
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
