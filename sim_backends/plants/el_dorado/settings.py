"""Settings of the simulated El-Dorado and its ground."""

from typing import Annotated, Literal

from pydantic import Field

from drivers.settings import Settings


class Mound(Settings):
    """A bell-shaped mound.

    Attributes:
        x_m: Position of the top.
        y_m: Position of the top.
        height_m: Height of the top.
        radius_m: Standard deviation of the bell shape.
    """

    x_m: float
    y_m: float
    height_m: Annotated[float, Field(ge=-2, le=2)]
    radius_m: Annotated[float, Field(gt=0.05, le=50)]


class Ground(Settings):
    """The shape of the ground, and the soil.

    Attributes:
        inclination_deg: Inclination of the slope below the mounds.
        uphill_deg: Direction of steepest ascent, counter-clockwise from x.
        mounds: Mounds on the slope.
        soil: A soil of the library (`sim_backends/terramechanics/soil/library/soils`), or a TOML file.
    """

    inclination_deg: Annotated[float, Field(ge=0, le=40)] = 0.0
    uphill_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    mounds: tuple[Mound, ...] = ()
    soil: str = "toyoura"


class ElDoradoPlantSettings(Settings):
    """The true rover and its ground; the controller has its own, possibly wrong, idea of both.

    Wheel and load are those of the single-wheel tests in Reina, Ishigami, Nagatani and Yoshida, "Odometry
    correction using visual slip angle estimation for planetary exploration rovers" (92 mm, 6.6 kg); track,
    wheel base, height of the centre of mass and motors are chosen.

    Attributes:
        start_x_m: Position at the start.
        start_y_m: Position at the start.
        start_yaw_deg: Heading at the start, counter-clockwise from x.
        wheel: A wheel of the library (`sim_backends/terramechanics/soil/library/wheels`), or a TOML file.
        wheel_radius_error: The true radius of the wheels is the wheel's radius times (1 +
            wheel_radius_error).
        track_m: Distance between left and right wheels.
        wheel_base_m: Distance between front and rear wheels.
        centre_height_m: Height of the centre of mass above the ground.
        mass_kg: Mass of the rover.
        ground: Shape of the ground, and soil.
        force_fluctuation: Standard deviation of the soil's horizontal forces on each wheel, as a share.
        fluctuation_time_s: Correlation time of these forces.
        speed_lag_s: Time constant of the inner speed loop.
        steer_rate_rad_s: Speed of the steering drives.
        no_load_current_a: Current of a motor that turns without load.
        torque_per_ampere_nm: Torque at the wheel per current, with gear and efficiency.
        resistance_ohm: Resistance of a motor.
        battery_v: Voltage of the battery without load.
        battery_fall_v_s: By how much the voltage that the devices report falls per second from the start; the
            motors keep their power.
        battery_resistance_ohm: Internal resistance of the battery.
        idle_current_a: Current of the electronics.
    """

    type: Literal["el_dorado"] = "el_dorado"
    start_x_m: float = 0.0
    start_y_m: float = 0.0
    start_yaw_deg: float = 0.0
    wheel: str = "el_dorado"
    wheel_radius_error: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.0
    track_m: Annotated[float, Field(gt=0.1, le=3)] = 0.44
    wheel_base_m: Annotated[float, Field(gt=0.1, le=3)] = 0.60
    centre_height_m: Annotated[float, Field(ge=0, le=1)] = 0.25
    mass_kg: Annotated[float, Field(ge=4, le=200)] = 26.4
    ground: Ground = Ground()
    force_fluctuation: Annotated[float, Field(ge=0, le=0.3)] = 0.1
    fluctuation_time_s: Annotated[float, Field(ge=0.5, le=60)] = 4.0
    speed_lag_s: Annotated[float, Field(ge=0.02, le=2)] = 0.1
    steer_rate_rad_s: Annotated[float, Field(gt=0, le=10)] = 0.3
    no_load_current_a: Annotated[float, Field(ge=0, le=5)] = 0.15
    torque_per_ampere_nm: Annotated[float, Field(gt=0)] = 1.8
    resistance_ohm: Annotated[float, Field(gt=0)] = 1.0
    battery_v: Annotated[float, Field(gt=0)] = 25.0
    battery_fall_v_s: Annotated[float, Field(ge=0)] = 0.0
    battery_resistance_ohm: Annotated[float, Field(ge=0)] = 0.1
    idle_current_a: Annotated[float, Field(ge=0)] = 1.0
