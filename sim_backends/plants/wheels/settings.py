"""Settings of a dynamic rover on any set of wheels."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from drivers.settings import Settings
from sim_backends.plants.robotino.site import Site, load_site

Place = Annotated[float, Field(ge=-10, le=10)]
Positive = Annotated[float, Field(gt=0)]


class WheelMotor(Settings):
    """Torque-speed line of a motor with its gear, at the wheel and at the supply's voltage.

    Attributes:
        stall_torque_nm: Torque at rest.
        no_load_rad_s: Speed of the wheel without load.
        stall_current_a: Current at rest.
    """

    stall_torque_nm: Positive = 10.0
    no_load_rad_s: Positive = 12.0
    stall_current_a: Positive = 5.0


class WheelServo(Settings):
    """A steering drive that moves to its setpoint at constant speed.

    Attributes:
        low_deg: Least angle.
        high_deg: Greatest angle.
        rate_deg_s: Speed.
        offset_deg: True angle at setpoint 0.
    """

    low_deg: Annotated[float, Field(ge=-360, le=0)]
    high_deg: Annotated[float, Field(ge=0, le=360)]
    rate_deg_s: Annotated[float, Field(gt=0, le=1000)] = 90.0
    offset_deg: Annotated[float, Field(ge=-30, le=30)] = 0.0


class PlantWheel(Settings):
    """One wheel; keys as in [[rover.wheels]].

    Attributes:
        x_m: Contact point, forward of the origin of the body frame.
        y_m: Contact point, to the left of it.
        radius_m: Radius of the wheel.
        angle_deg: Direction in which the wheel rolls forwards, counter-clockwise from x.
        driven: False where no motor turns the wheel.
        roller_deg: Angle from the wheel's axle to the axle of the roller on the ground.
        steering: Its steering drive; without one it does not steer.
        motor: Its motor.
    """

    x_m: Place
    y_m: Place
    radius_m: Annotated[float, Field(gt=0, le=1)]
    angle_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    driven: bool = True
    roller_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    steering: WheelServo | None = None
    motor: WheelMotor | None = None


class Castor(Settings):
    """A swivelling wheel or a slide that carries load and only resists the motion.

    Attributes:
        x_m: Contact point.
        y_m: Contact point.
        drag: Resistance per load.
    """

    x_m: Place
    y_m: Place
    drag: Annotated[float, Field(ge=0, le=1)] = 0.02


def _site(value: object) -> object:
    return load_site(value) if isinstance(value, str) else value


class WheelsPlantSettings(Settings):
    """The true rover and its ground; the controller has its own, possibly wrong, idea of both.

    Attributes:
        wheels: The true wheels, in the order of the wheel device. A configuration that leaves them out has
            those of [[rover.wheels]].
        castors: Further contacts that carry load.
        site: The ground, as of the Robotino plant: name of a shipped site, path of a TOML map, or the map.
        start_x_m: Position at the start.
        start_y_m: Position at the start.
        start_yaw_deg: Heading at the start, counter-clockwise from x.
        mass_kg: Mass of the rover.
        centre_of_mass_x_m: Centre of mass, forward of the origin; with y it sets the wheel loads.
        centre_of_mass_y_m: Centre of mass, to the left of the origin.
        yaw_inertia_kg_m2: Inertia about the centre of mass; without it that of a box around the wheels.
        wheel_inertia_kg_m2: Inertia of a wheel with its motor and gear, at the wheel.
        wheel_friction_nm: Coulomb friction of a wheel with its gear.
        wheel_radius_error: True radius over that of `wheels`, less one.
        speed_gain: Bridge duty per speed error in rad/s of the drives' speed loops.
        speed_integral_per_s: Their integral gain, over the proportional one.
        set_point_delay_s: Delay from the host's command to the speed loops.
        battery_v: Voltage of the supply without load.
        battery_fall_v_s: By how much the voltage that the devices report falls per second from the start; the
            motors keep their power.
        battery_resistance_ohm: Its internal resistance.
        idle_current_a: Current of the electronics.
    """

    type: Literal["wheels"] = "wheels"
    wheels: Annotated[tuple[PlantWheel, ...], Field(min_length=2, max_length=32)]
    castors: tuple[Castor, ...] = ()
    site: Annotated[Site, BeforeValidator(_site)] = Field(default_factory=Site)
    start_x_m: float = 0.0
    start_y_m: float = 0.0
    start_yaw_deg: float = 0.0
    mass_kg: Annotated[float, Field(gt=0, le=10_000)] = 20.0
    centre_of_mass_x_m: Place = 0.0
    centre_of_mass_y_m: Place = 0.0
    yaw_inertia_kg_m2: Positive | None = None
    wheel_inertia_kg_m2: Positive = 0.01
    wheel_friction_nm: Annotated[float, Field(ge=0)] = 0.05
    wheel_radius_error: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    speed_gain: Positive = 2.0
    speed_integral_per_s: Annotated[float, Field(ge=0)] = 5.0
    set_point_delay_s: Annotated[float, Field(ge=0, le=1)] = 0.02
    battery_v: Positive = 24.0
    battery_fall_v_s: Annotated[float, Field(ge=0)] = 0.0
    battery_resistance_ohm: Annotated[float, Field(ge=0)] = 0.05
    idle_current_a: Annotated[float, Field(ge=0)] = 0.5
