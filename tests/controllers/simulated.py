"""A small rover made from geometry alone, so that no error of the controllers' kinematics can cancel out."""

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from controllers.control_loop import ControlLoop, StepOutput
from controllers.estimation.ground_settings import GroundSettings
from controllers.estimation.settings import FilterSettings
from controllers.motion.rover_geometry import OmniRoverSettings, SkidSteerRoverSettings
from controllers.motion.settings import LimitSettings, MissionSettings, RectangleMission, WaypointsMission
from controllers.roles import DeviceRoles
from controllers.safety.settings import SafetySettings
from controllers.settings import ControlSettings
from drivers.samples import HeadingReference, HeadingSample, RateSample, Sample, WheelSample

MS = 1_000_000
SECOND_NS = 1_000_000_000
TICK_NS = MS
PERIOD_NS = 20 * MS
START_NS = SECOND_NS

OMNI = OmniRoverSettings(kinematics="omni3", wheel_radius_m=0.04, base_radius_m=0.125)
SKID = SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.1, track_m=0.4)
LIMITS = LimitSettings(wheel_speed_rad_s=12.0, wheel_acceleration_rad_s2=10.0)
ROLES = DeviceRoles(
    wheels="wheels",
    gyro="gyro",
    headings=("compass",),
    required={"wheels": 0.15, "gyro": 0.15, "compass": 0.25},
)


@dataclass(frozen=True)
class Geometry:
    """Where each wheel touches the ground and which way it drives, one complex number each (x + i y)."""

    contact: NDArray[np.complex128]
    drive: NDArray[np.complex128]
    radius_m: float

    def wheel_speeds(self, velocity_m_s: complex, yaw_rate_rad_s: float) -> NDArray[np.float64]:
        """Speed of the ground under each contact, along the wheel's drive direction."""
        at_contact = velocity_m_s + 1j * yaw_rate_rad_s * self.contact
        return np.real(at_contact * np.conj(self.drive)) / self.radius_m

    def twist(self, wheel_rad_s: NDArray[np.float64]) -> tuple[complex, float]:
        """Body velocity of rolling wheels, by least squares."""
        x, y, turn = (self._least_squares @ wheel_rad_s).tolist()
        return complex(x, y), turn

    @cached_property
    def _least_squares(self) -> NDArray[np.float64]:
        unit_twists = ((1.0 + 0j, 0.0), (1j, 0.0), (0j, 1.0))
        return np.linalg.pinv(np.stack([self.wheel_speeds(v, w) for v, w in unit_twists], axis=1))


def omni_geometry(angles_deg: Sequence[float] = (60.0, 180.0, 300.0)) -> Geometry:
    spokes: NDArray[np.complex128] = np.array([cmath.rect(1.0, math.radians(angle)) for angle in angles_deg])
    return Geometry(contact=0.125 * spokes, drive=1j * spokes, radius_m=0.04)


def skid_geometry() -> Geometry:
    corners: NDArray[np.complex128] = np.array([0.15 + 0.2j, 0.15 - 0.2j, -0.15 + 0.2j, -0.15 - 0.2j])
    # Without skidding resistance along the axle only the sides count: contacts on the y axis.
    return Geometry(contact=0.5 * (corners - np.conj(corners)), drive=np.ones(4, dtype=complex), radius_m=0.1)


@dataclass
class Noise:
    """Standard deviations of the sensors, and the gyro's bias."""

    gyro_rad_s: float = 0.0
    gyro_bias_rad_s: float = 0.0
    heading_rad: float = 0.0
    heading_offset_rad: float = 1.0


@dataclass
class SimulatedRover:
    """Wheels that follow their setpoints with a lag of 50 ms, and sensors that sample in turn.

    Attributes:
        mute: Called with each sample; what it returns is delivered instead (None: nothing).
        slip: Share of the wheels' motion that does not move the body.
        jammed: Wheels that do not turn.
    """

    geometry: Geometry
    generator: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    noise: Noise = field(default_factory=Noise)
    mute: Callable[[Sample], Sample | None] = field(default=lambda sample: sample)
    slip: float | NDArray[np.float64] = 0.0
    jammed: tuple[int, ...] = ()
    t_ns: int = START_NS
    place: complex = 0j
    yaw_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0

    def __post_init__(self) -> None:
        count = len(self.geometry.drive)
        self.position_rad = np.zeros(count)
        self.speed_rad_s = np.zeros(count)
        self.set_point_rad_s = np.zeros(count)

    def advance(self, until_ns: int) -> list[Sample]:
        """Run to `until_ns` in ticks of 1 ms; return the samples in order of arrival."""
        samples: list[Sample] = []
        while self.t_ns < until_ns:
            self._tick()
            samples += [heard for sample in self._sense() if (heard := self.mute(sample)) is not None]
        return samples

    def _tick(self) -> None:
        dt_s = TICK_NS / SECOND_NS
        self.speed_rad_s = self.speed_rad_s + (self.set_point_rad_s - self.speed_rad_s) * dt_s / 0.05
        self.speed_rad_s[list(self.jammed)] = 0.0
        self.position_rad = self.position_rad + self.speed_rad_s * dt_s
        velocity, self.yaw_rate_rad_s = self.geometry.twist(self.speed_rad_s * (1.0 - self.slip))
        turn_rad = self.yaw_rate_rad_s * dt_s
        # Exact arc of a constant twist: its chord points half the turn ahead.
        chord_s = dt_s * math.sin(0.5 * turn_rad) / (0.5 * turn_rad) if turn_rad else dt_s
        self.place += cmath.rect(chord_s, self.yaw_rad + 0.5 * turn_rad) * velocity
        self.yaw_rad += turn_rad
        self.t_ns += TICK_NS

    def _sense(self) -> list[Sample]:
        tick = self.t_ns // TICK_NS
        sensed: list[Sample] = [
            WheelSample(device="wheels", t_ns=self.t_ns, wheel=wheel, position_rad=float(position))
            for wheel, position in enumerate(self.position_rad)
            # One wheel after the other, 1 ms apart, each at 100 Hz.
            if tick % 10 == wheel
        ]
        if tick % 5 == 0:
            rate_rad_s = self.yaw_rate_rad_s + self.noise.gyro_bias_rad_s
            rate_rad_s += self.noise.gyro_rad_s * float(self.generator.normal())
            sensed.append(RateSample(device="gyro", t_ns=self.t_ns, rate_z_rad_s=rate_rad_s))
        if tick % 50 == 7:
            heading_rad = self.yaw_rad + self.noise.heading_offset_rad
            heading_rad += self.noise.heading_rad * float(self.generator.normal())
            sensed.append(
                HeadingSample(
                    device="compass",
                    t_ns=self.t_ns,
                    heading_rad=math.remainder(heading_rad, math.tau),
                    reference=HeadingReference.MAGNETIC,
                )
            )
        return sensed


def make_settings(
    rover: OmniRoverSettings | SkidSteerRoverSettings = OMNI,
    mission: MissionSettings | None = None,
    filter_settings: FilterSettings | None = None,
    safety: SafetySettings | None = None,
    ground: GroundSettings | None = None,
) -> ControlSettings:
    return ControlSettings(
        rover=rover,
        limits=LIMITS,
        mission=mission,
        filter=filter_settings or FilterSettings(),
        ground=ground or GroundSettings(),
        safety=safety or SafetySettings(),
    )


def rectangle(heading: str = "hold") -> RectangleMission:
    return RectangleMission.model_validate(
        {"type": "rectangle", "length_m": 0.9, "width_m": 0.4, "speed_m_s": 0.2, "heading": heading}
    )


def run(
    loop: ControlLoop, rover: SimulatedRover, duration_s: float, period_s: float = 0.02
) -> list[StepOutput]:
    """Close the loop for `duration_s` from the rover's present time."""
    outputs: list[StepOutput] = []
    period_ns = round(period_s * SECOND_NS)
    for _ in range(round(duration_s / period_s)):
        samples = rover.advance(rover.t_ns + period_ns)
        outputs.append(loop.step(rover.t_ns, samples))
        rover.set_point_rad_s = np.array(outputs[-1].command.speed_rad_s)
    return outputs


HONEST = Noise(gyro_rad_s=0.01, gyro_bias_rad_s=0.02, heading_rad=0.03)
LONG_WAY = WaypointsMission(type="waypoints", points=((50.0, 0.0),), speed_m_s=0.2)


def omni_rover(seed: int = 0, noise: Noise = HONEST) -> SimulatedRover:
    return SimulatedRover(omni_geometry(), np.random.default_rng(seed), noise)


def long_drive() -> ControlLoop:
    return ControlLoop(make_settings(mission=LONG_WAY), ROLES)


def silent(device: str) -> Callable[[Sample], Sample | None]:
    """Return a fault: nothing from `device`."""
    return lambda sample: None if sample.device == device else sample
