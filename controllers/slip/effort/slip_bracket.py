"""Slip between two readings of the body's response to a small yaw excitation. Plain floats.

For a contact with traction F(x, u) of rim speed x and wheel speed u over the ground, K_x = dF/dx, K_u =
-dF/du, yaw inertia J, slope d of the ground's drag, distance L of the wheels from the centre, relaxation time
t and angular frequency w, the turning of the body over that of the wheels is H with

    1/H = [L^2 sum K_u + (d + j w J)(1 + j w t)] / (L^2 sum K_x)

- Where traction depends on the slip ratio, K_u / K_x = 1 / (1 - s) at any point of the curve: the secant
  reading S = 1 - 1 / Re(1/H) is the slip, up to drag and relaxation.
- Where traction depends on the slip velocity, K_u = K_x, and S reads too little. The lag then gives the slope
  of the traction, and the drive force F over that slope is the slip speed: G = c F L^2 tan(lag) / (w J v),
  an upper bound where traction neither falls nor stiffens with slip velocity.

Sources: Canudas de Wit et al. 1995 and 2003 (LuGre, rolling contact); Pacejka, Tire and Vehicle Dynamics
(brush model, relaxation length).
"""

import cmath
import math
from typing import NamedTuple

from controllers.motion.kinematics import Kinematics
from controllers.slip.effort.parameters import EFFORT

IN_NOISE = "the body's response to the excitation is within its noise"
FALLING_TRACTION = "traction falls with slip: the wheels are beyond its peak"
IDLE_WHEELS = "the body lags with hardly any drive force: wheels turn without grip"
OPPOSITE = "the body swings against the wheels"
SMALLEST_SHARE = 0.005
"""A smaller response has no phase."""
NO_PULL = 1e-9
"""Sum of squared cosines up to which no wheel pulls along a direction."""
UNIFORM = math.sqrt(12.0)
"""Width of a uniform distribution over its standard deviation."""


class BodyResponse(NamedTuple):
    """Response of the body to the excitation of the wheels.

    Attributes:
        share: Turning of the body over that of the wheels, the sensors' response taken out; a negative angle
            is a lag.
        noise: Standard deviation of each part of `share`, by the scatter of the readings.
        lag_sd_rad: Standard deviation of the angle of the sensors' response.
        gain_sd: Relative standard deviation of its size.
    """

    share: complex
    noise: float
    lag_sd_rad: float = 0.0
    gain_sd: float = 0.0


class DrivenTravel(NamedTuple):
    """Travel during the response.

    Attributes:
        speed_m_s: By the wheels.
        force_n: Mean drive force along the travel; None where it is unknown.
    """

    speed_m_s: float
    force_n: float | None


class YawLever(NamedTuple):
    """What turns a yaw response into a slope of traction.

    Attributes:
        frequency_hz: Of the excitation.
        inertia_kg_m2: Yaw inertia of the rover.
        mass_kg: Its mass.
        per_slip_m2: Yaw stiffness of the wheels over their stiffness along the travel, see `per_slip_m2`.
    """

    frequency_hz: float
    inertia_kg_m2: float
    mass_kg: float
    per_slip_m2: float


class SlipReading(NamedTuple):
    """Slip ratio that gives the translation of the rover.

    Attributes:
        slip: 0 to 1.
        sd: Its standard deviation.
        problem: Why it is not valid; empty where it is.
        secant: Reading from what the body lacks in phase.
        bound: Reading from lag and drive force.
    """

    slip: float
    sd: float
    problem: str = ""
    secant: float = 0.0
    bound: float = 0.0


def per_slip_m2(kinematics: Kinematics, wheel_radius_m: float, direction_rad: float) -> float:
    """Return the wheels' yaw stiffness over their stiffness along a direction of travel, c L^2, in m^2.

    With equal wheels it is the sum of the squared arms over the sum of the squared cosines between the
    directions of traction and the travel: c = 2 for three omnidirectional wheels at 120 degrees, 1 for two
    parallel ones. 0 where no wheel pulls along the travel.

    Args:
        kinematics: Of wheels that do not steer.
        wheel_radius_m: Radius of the wheels.
        direction_rad: Of the travel, in the body frame.
    """
    along = kinematics.wheel_speeds(math.cos(direction_rad), math.sin(direction_rad), 0.0)
    arms = kinematics.wheel_speeds(0.0, 0.0, 1.0)
    squares = sum((wheel_radius_m * speed) ** 2 for speed in along)
    if squares < NO_PULL:
        return 0.0
    return sum((wheel_radius_m * arm) ** 2 for arm in arms) / squares


def read_slip(response: BodyResponse, travel: DrivenTravel, lever: YawLever) -> SlipReading:
    """Return the slip between the secant reading and the bound by lag and force.

    Its standard deviation holds what the contact law leaves open: the slip may be anywhere from the secant
    reading to the bound, or to 1 where the bound is larger. The secant reading itself is too small where one
    wheel grips and the others slide, as the wheel does that is across the travel.
    """
    numbers = EFFORT.bracket
    size = abs(response.share)
    if size <= max(SMALLEST_SHARE, numbers.deviations * response.noise):
        return SlipReading(0.0, 1.0, IN_NOISE)
    inverse = 1.0 / response.share
    # The uncertain angle of the sensors turns 1/H, and so moves its imaginary part.
    lag_noise = math.hypot(response.noise / size**2, response.lag_sd_rad * abs(inverse))
    if inverse.real <= 0.0:
        return SlipReading(0.0, 1.0, OPPOSITE)
    if inverse.imag < -numbers.deviations * lag_noise:
        return SlipReading(0.0, 1.0, FALLING_TRACTION)
    force_n_kg = None if travel.force_n is None else travel.force_n / lever.mass_kg
    is_idle = force_n_kg is not None and force_n_kg < numbers.idle_force_n_kg
    if is_idle and inverse.imag - numbers.deviations * lag_noise > numbers.idle_lag * inverse.real:
        return SlipReading(0.0, 1.0, IDLE_WHEELS)
    secant, bound = _ends(inverse, travel, lever)
    slip = _between(secant, bound)
    angle_sd_rad = math.hypot(response.lag_sd_rad, response.noise / size)
    by_angle = max(
        abs(_between(*_ends(inverse * cmath.exp(1j * angle_rad), travel, lever)) - slip)
        for angle_rad in (-angle_sd_rad, angle_sd_rad)
    )
    by_gain = _between(*_ends(inverse * (1.0 + response.gain_sd), travel, lever)) - slip
    sd = math.hypot(
        numbers.sd,
        max(0.0, min(bound, 1.0) - secant) / UNIFORM,
        numbers.sd_secant * secant,
        response.noise,
        by_angle,
        by_gain,
    )
    return SlipReading(slip, sd, "", secant, bound)


def read_slip_by_unknown_gyro(response: BodyResponse, travel: DrivenTravel, lever: YawLever) -> SlipReading:
    """Return the slip that the response shows at least, whatever the delay of the gyro.

    The delay is between 0 and `greatest_delay_s`. The slip is the least of the readings for these delays, so
    that a late gyro is never taken for slip; the standard deviation contains the others.
    """
    numbers = EFFORT.bracket
    turning = math.tau * lever.frequency_hz
    first = read_slip(response, travel, lever)
    if first.problem in (IN_NOISE, FALLING_TRACTION):
        return first
    found = [first]
    for step in range(1, numbers.delay_steps + 1):
        delay_s = numbers.greatest_delay_s * step / numbers.delay_steps
        early = response._replace(share=response.share * cmath.exp(1j * turning * delay_s))
        found.append(read_slip(early, travel, lever))
    if found[-1].problem in (IDLE_WHEELS, OPPOSITE):
        return found[-1]
    # A delay that makes the lag negative says that the gyro is less late.
    usable = [reading for reading in found if not reading.problem]
    if not usable:
        return first
    least, greatest = min(usable), max(usable)
    # Idle wheels, where a delay says so, may slip by any amount.
    most = 1.0 if any(reading.problem == IDLE_WHEELS for reading in found) else greatest.slip
    # Of a uniform distribution about its end.
    by_delay = (most - least.slip) / math.sqrt(3.0)
    sd = math.hypot(max(reading.sd for reading in usable), by_delay)
    return SlipReading(least.slip, sd, "", least.secant, max(reading.bound for reading in usable))


def _ends(inverse: complex, travel: DrivenTravel, lever: YawLever) -> tuple[float, float]:
    """Return the secant reading and the bound by lag and force for 1/H; zeros where it is not positive."""
    if inverse.real <= 0.0:
        return 0.0, 0.0
    numbers = EFFORT.bracket
    force_n = numbers.usual_force_n_kg * lever.mass_kg if travel.force_n is None else travel.force_n
    speed_m_s = max(travel.speed_m_s, numbers.least_speed_m_s)
    slope = inverse.imag / inverse.real
    turning = math.tau * lever.frequency_hz
    bound = force_n * lever.per_slip_m2 * slope / (turning * lever.inertia_kg_m2 * speed_m_s)
    return max(0.0, 1.0 - 1.0 / inverse.real), max(0.0, bound)


def _between(secant: float, bound: float) -> float:
    """Return the slip between the secant reading and the bound."""
    return secant + EFFORT.bracket.weight * width_of(secant, bound)


def width_of(secant: float, bound: float) -> float:
    """Return the width of the bracket, as far as it counts."""
    return max(0.0, min(bound, EFFORT.bracket.greatest_bound) - secant)
