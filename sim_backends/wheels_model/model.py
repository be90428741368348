"""The drive of a rover on any set of wheels: from the speeds of its wheels to the motion of its body.

Base: the list of wheels with the loads, the castors and the ground of `[simulation.plant]`. In windows of
0.2 s or more the mean speeds and steering angles of the wheels give the motion of the body at which the
contacts carry its inertia (`force_balance`), and the gyro measures its yaw rate. Pose and heading are not
integrated over the drive, so that an error affects only its own windows, and the stretches of 4 s that hold
them: over these the motion is integrated, where a small error of a radius or a place adds up.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.models.delay import earlier, later
from sim_backends.models.drive_effects import of_wheel
from sim_backends.models.interface import Array, Channel, EffectCard, Parameter, Run, Values, parameter
from sim_backends.models.nominal_values import NominalValues
from sim_backends.plants.robotino.surfaces import Surface
from sim_backends.plants.wheels.plant import make_rover
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.wheels_model.effects import PARAMETERS, effects_of
from sim_backends.wheels_model.force_balance import Contact, Wheels, balanced_motion, rolling_motion
from sim_backends.wheels_model.stretches import over_stretches

GYRO = "gyro_rad_s"
HEADING = "heading_rad"
STRETCHES = {"stretch_forward_m": "m", "stretch_left_m": "m", "stretch_turn_rad": "rad"}
"""Channels of the motion over stretches, and their units."""
CHANNELS = (
    Channel(name="forward_m_s", unit="m/s"),
    Channel(name="left_m_s", unit="m/s"),
    Channel(name="turn_rad_s", unit="rad/s"),
    Channel(name=GYRO, unit="rad/s", is_optional=True),
    *(Channel(name=name, unit=unit, is_optional=True) for name, unit in STRETCHES.items()),
)


class WheelsModel:
    """A `Model` of the drive of a rover on any set of wheels.

    Condition: mean speed of a drive. Wheels without a motor may lack a sensor: then they roll freely.

    Args:
        settings: The rover and its ground; patches of the site are not in the model.

    Raises:
        ConfigError: The centre of mass is outside the contacts.
    """

    name = "wheels"
    channels: tuple[Channel, ...] = CHANNELS
    condition_units: Mapping[str, str] = {"speed_m_s": "m/s"}

    def __init__(self, settings: WheelsPlantSettings) -> None:
        self._rover = make_rover(settings)
        self._surface: Surface = settings.site.surfaces[settings.site.floor]
        self.wheel_count = len(settings.wheels)
        self.steers = any(wheel.steering is not None for wheel in settings.wheels)
        self.driven = tuple(number for number, one in enumerate(settings.wheels, start=1) if one.driven)
        self.parameters: tuple[Parameter, ...] = _parameters(self.driven)
        axles = {wheel.x_m for wheel in settings.wheels if wheel.roller_deg is None}
        self.effects: tuple[EffectCard, ...] = effects_of(
            self.driven,
            tuple(number for number, one in enumerate(settings.wheels, start=1) if one.steering is not None),
            self._surface.drag_along,
            skids=not self.steers and len(axles) > 1,
        )
        steering = {f"steering_{wheel}_rad": "rad" for wheel in self._numbers} if self.steers else {}
        self.input_units: Mapping[str, str] = {
            "t_s": "s",
            **{f"wheel_{wheel}_rad_s": "rad/s" for wheel in self.driven},
            **steering,
            HEADING: "rad",
        }
        self._nominal = NominalValues(self.parameters, self.effects)

    @property
    def _numbers(self) -> range:
        return range(1, self.wheel_count + 1)

    def predict(
        self, runs: Sequence[Run], parameters: Values, effects: Mapping[str, Values]
    ) -> list[dict[str, Array]]:
        """Predict motion and gyro of every run. See `Model.predict`."""
        base, active = self._nominal.fill(parameters, effects)
        return [self._table(run, base, active) for run in runs]

    def _table(self, run: Run, base: Values, active: Mapping[str, Values]) -> dict[str, Array]:
        t_s = run.inputs["t_s"]
        rover, wheels = self._rover, self._wheels(run, base, active)
        rolling = rolling_motion(rover, wheels)
        acceleration = np.gradient(rolling, t_s, axis=0)
        weight = self._weight(run.inputs[HEADING], active["side_slope"])
        load = weight - acceleration @ rover.mass.T
        twist = balanced_motion(rover, wheels, self._contact(base, active), load, rolling)
        if "rotation_centre" in active:
            twist[:, 1] -= active["rotation_centre"]["ahead_m"] * twist[:, 2]
        age_s = base["pose_age_s"] + active["latency"]["time"]
        forward, left, turn = (_shifted(t_s, one, age_s) for one in _at_marker(twist, base).T)
        stretches = over_stretches(t_s, np.stack((forward, left, turn), axis=1))
        rate = _shifted(t_s, twist[:, 2], base["gyro_age_s"])
        return {
            "forward_m_s": forward,
            "left_m_s": left,
            "turn_rad_s": turn,
            GYRO: (1.0 + active["gyro_scale"]["error"]) * rate
            + base["gyro_bias_rad_s"]
            + active["gyro_bias"]["rate"],
            **dict(zip(STRETCHES, stretches.T, strict=True)),
        }

    def _wheels(self, run: Run, base: Values, active: Mapping[str, Values]) -> Wheels:
        common = 1.0 + base["radius_error"] + active["wheel_radius"]["error"]
        rims, along, t_s = [], [], run.inputs["t_s"]
        for index, wheel in enumerate(self._numbers):
            own = base.get(_own_error(wheel), 0.0) + of_wheel(active.get("uneven_wheel", {}), wheel, "error")
            radius_m = float(self._rover.radius_m[index]) * (common + own)
            turning = run.inputs.get(f"wheel_{wheel}_rad_s")
            rims.append(np.full(t_s.shape, np.nan) if turning is None else radius_m * turning)
            angle = np.full(t_s.shape, float(self._rover.angle[index]))
            if self.steers:
                offset_deg = of_wheel(active["steering_offset"], wheel, "angle_deg")
                ratio = 1.0 + active["steering_ratio"]["error"]
                angle = angle + ratio * run.inputs[f"steering_{wheel}_rad"] + math.radians(offset_deg)
            along.append(angle)
        wider = 1.0 + base["base_error"] + active["base_radius"]["error"]
        place_m = self._rover.place.copy()
        place_m[: self.wheel_count] *= wider
        return Wheels(np.stack(rims, axis=1), np.stack(along, axis=1), place_m)

    def _contact(self, base: Values, active: Mapping[str, Values]) -> Contact:
        surface = self._surface
        change = base["stiffness_change"] + active["contact_stiffness"]["change"]
        return Contact(
            friction=surface.friction,
            stiffness=surface.stiffness * math.exp(change),
            drag_along=surface.drag_along + active["rolling_resistance"]["share"],
            drag_across=surface.drag_across,
        )

    def _weight(self, heading_rad: Array, slope: Values) -> Array:
        """Return force and moment of the weight along the slope, in the body frame."""
        mass_kg = float(self._rover.mass[0, 0])
        force_n = mass_kg * STANDARD_GRAVITY_M_S2 * math.sin(math.radians(slope["angle_deg"]))
        downhill = math.radians(slope["downhill_deg"]) - heading_rad
        x_n, y_n = force_n * np.cos(downhill), force_n * np.sin(downhill)
        ahead_m, aside_m = self._rover.mass[1, 2] / mass_kg, -self._rover.mass[0, 2] / mass_kg
        return np.stack((x_n, y_n, ahead_m * y_n - aside_m * x_n), axis=1)


def _at_marker(twist: Array, base: Values) -> Array:
    """Return the motion of the point that the poses are of, along the axes of their yaw."""
    forward = twist[:, 0] - base["marker_y_m"] * twist[:, 2]
    left = twist[:, 1] + base["marker_x_m"] * twist[:, 2]
    cosine, sine = math.cos(base["marker_yaw_rad"]), math.sin(base["marker_yaw_rad"])
    return np.stack((cosine * forward + sine * left, cosine * left - sine * forward, twist[:, 2]), axis=1)


def _shifted(t_s: Array, rate: Array, age_s: float) -> Array:
    """Return the rates that a pose of this age shows; a negative one is ahead of the wheels."""
    return earlier(t_s, rate, age_s) if age_s >= 0.0 else later(t_s, rate, -age_s)


def _own_error(wheel: int) -> str:
    return f"wheel_{wheel}_error"


def _parameters(driven: Sequence[int]) -> tuple[Parameter, ...]:
    *others, last = driven
    uneven = (
        parameter(
            _own_error(wheel),
            "1",
            0.0,
            0.002,
            -0.3,
            0.3,
            f"radius of wheel {wheel} over wheel {last}, less one",
        )
        for wheel in others
    )
    radius, *rest = PARAMETERS
    return (radius, *uneven, *rest)
