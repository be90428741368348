"""Settings of the dynamic Robotino."""

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from drivers.settings import Settings
from sim_backends.plants.robotino.site import Site, load_site


class MotorSettings(Settings):
    """One of three gear motors, Dunkermotoren GR 42x25, 24 V, with planetary gear, wheel and rollers.

    Source: BrOleg5/Slippage-compensation and research-wheel-slippage: R, Ke, Kt, L and inertia (with gear
    and wheel) as identified there; friction from the no-load record (0.165 A at 20 rad/s, 0.22 A at
    168 rad/s). Gear efficiency and breakaway are assumed.

    Attributes:
        resistance_ohm: Resistance of the winding.
        inductance_h: Inductance of the winding.
        torque_constant_nm_per_a: Torque per current at the motor.
        speed_constant_v_s_per_rad: Induced voltage per motor speed.
        inertia_kg_m2: Inertia of rotor, gear and wheel, at the motor.
        friction_nm: Coulomb friction at the turning motor.
        breakaway: Friction at rest divided by friction while turning.
        viscous_nm_s: Friction per motor speed.
        gear_ratio: Turns of the motor per turn of the wheel.
        gear_efficiency: Share of the torque that passes the gear, in either direction of power.
    """

    resistance_ohm: Annotated[float, Field(gt=0)] = 5.336
    inductance_h: Annotated[float, Field(gt=0)] = 8.9e-3
    torque_constant_nm_per_a: Annotated[float, Field(gt=0)] = 0.0514
    speed_constant_v_s_per_rad: Annotated[float, Field(gt=0)] = 0.0501
    inertia_kg_m2: Annotated[float, Field(gt=0)] = 1.0448e-5
    friction_nm: Annotated[float, Field(ge=0)] = 8.1e-3
    breakaway: Annotated[float, Field(ge=1, le=3)] = 1.3
    viscous_nm_s: Annotated[float, Field(ge=0)] = 1.9e-5
    gear_ratio: Annotated[float, Field(gt=0)] = 16.0
    gear_efficiency: Annotated[float, Field(gt=0, le=1)] = 0.8


class SpeedLoopSettings(Settings):
    """The speed controller of an EA05 board: setpoint plus gain times error, in counts of the bridge.

    It counts encoder ticks over its own period, so speed comes in whole ticks and the current ripples. Its
    clock is independent of the host's: the phase and a small error of the rate are drawn at random.

    Attributes:
        rate_hz: Rate of the controller.
        rate_error: Standard deviation of the rate, as a share of it.
        steps_per_period: Integration steps in a period of the controller.
        gain: Counts of the bridge per tick of speed error; fitted to the droop of 2.5 ticks per ampere in 288
            runs (BrOleg5/research-wheel-slippage).
        ticks_per_turn: Encoder counts per turn of the motor.
        set_point_delay_s: Delay from the host's command to the controller; with the wheel's own few
            milliseconds this is the 0.1 s identified there.
    """

    rate_hz: Annotated[float, Field(ge=500, le=5000)] = 900.0
    rate_error: Annotated[float, Field(ge=0, le=0.01)] = 0.001
    steps_per_period: Annotated[int, Field(ge=2, le=100)] = 2
    gain: Annotated[float, Field(ge=0)] = 20.8
    ticks_per_turn: Annotated[int, Field(gt=0)] = 2000
    set_point_delay_s: Annotated[float, Field(ge=0, le=1)] = 0.09


def _site(value: object) -> object:
    return load_site(value) if isinstance(value, str) else value


class RobotinoPlantSettings(Settings):
    """The true rover and its ground; the controller has its own, possibly wrong, idea of both.

    Attributes:
        site: The ground: name of a shipped site, path of a TOML map, or the map itself.
        start_x_m: Position at the start.
        start_y_m: Position at the start.
        start_yaw_deg: Heading at the start, counter-clockwise from x.
        motor: Motors and gears.
        speed_loop: The board's speed controllers.
        wheel_radius_m: Radius of the wheels.
        wheel_offset_m: Distance of each wheel's contact point from the rover's centre.
        mass_kg: Mass of the rover.
        centre_of_mass_x_m: Distance of the centre of mass ahead of the rover's centre; it sets the wheel
            loads. The fitted value is behind the centre.
        yaw_inertia_kg_m2: Inertia about the centre of mass; the default is a disc of 12.6 kg and 0.185 m.
        battery_v: Voltage of the battery without load.
        battery_fall_v_s: By how much the voltage that the devices report falls per second from the start; the
            motors keep their power.
        battery_resistance_ohm: Internal resistance of the battery.
        idle_current_a: Current of the electronics.
        bumper_x_m: Position of the rover at which it touches a wall, which presses the bumper; without it
            there is no wall.
    """

    type: Literal["robotino"] = "robotino"
    site: Annotated[Site, BeforeValidator(_site)] = Field(default_factory=Site)
    start_x_m: float = 0.0
    start_y_m: float = 0.0
    start_yaw_deg: float = 0.0
    motor: MotorSettings = MotorSettings()
    speed_loop: SpeedLoopSettings = SpeedLoopSettings()
    wheel_radius_m: Annotated[float, Field(gt=0, le=1)] = 0.040
    wheel_offset_m: Annotated[float, Field(gt=0, le=2)] = 0.125
    mass_kg: Annotated[float, Field(gt=0, le=100)] = 12.6
    centre_of_mass_x_m: Annotated[float, Field(gt=-0.06, lt=0.06)] = -0.017
    yaw_inertia_kg_m2: Annotated[float, Field(gt=0)] = 0.216
    battery_v: Annotated[float, Field(gt=0)] = 26.0
    battery_fall_v_s: Annotated[float, Field(ge=0)] = 0.0
    battery_resistance_ohm: Annotated[float, Field(ge=0)] = 0.15
    idle_current_a: Annotated[float, Field(ge=0)] = 1.5
    bumper_x_m: float | None = None

    @model_validator(mode="after")
    def _check_loads(self) -> Self:
        # One wheel stands at 180 deg, the two others at 60 deg to the left and right of the nose.
        if not -1.0 < self.centre_of_mass_x_m / self.wheel_offset_m < 0.5:
            raise ValueError(
                "centre_of_mass_x_m lies outside the triangle of the wheels, so that the rover would tip: it "
                "must be above -wheel_offset_m and below half of wheel_offset_m"
            )
        return self
