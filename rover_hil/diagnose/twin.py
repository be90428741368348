"""The simulated twin: what drives have shown of a rover, as numbers of [simulation] with intervals."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydantic import ValidationError

from controllers.motion.rover_geometry import OmniRoverSettings, SkidSteerRoverSettings
from controllers.motion.wheel_constraints import skids_in_turns
from drivers.clock import date_of, wall_time_ns
from drivers.inertial_settings import InertialSettings
from rover_hil.config import Config
from rover_hil.diagnose.device_numbers import gyro_delays_s, gyro_noises_rad_s, set_point_delays_s
from rover_hil.diagnose.diagnosis import Diagnosis
from rover_hil.diagnose.forces import friction_of, ground_of_slip
from rover_hil.diagnose.intervals import Interval, mean_of
from rover_hil.diagnose.twin_number import TwinNumber, Unknown, rounded, single
from rover_hil.ready.procedure import Entry
from rover_hil.ready.wheels.from_drives import GeometryResult
from rover_hil.ready.wheels.geometry import BASE, RADIUS, Geometry, geometry_of
from rover_hil.ready.wheels.gyro_scale import GyroFit
from sim_backends.build import EMULATOR
from sim_backends.found import move
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.settings import PlantSettings, SimulationSettings
from sim_backends.world.inertial import InertialErrorSettings

STEP = 1e-4
"""Of a number of the wheels, for what depends on it."""
DELAYS = {
    "wheels": "plant.set_point_delay_s",
    "robotino": "plant.speed_loop.set_point_delay_s",
    "el_dorado": "plant.speed_lag_s",
}
"""Value of [simulation] that delays the wheels, by type of the plant."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Twin:
    """The numbers of a twin.

    Attributes:
        drives: Names of the drives that they are from.
        numbers: What is written.
        unknown: What is not.
    """

    drives: Sequence[str]
    numbers: Sequence[TwinNumber]
    unknown: Sequence[Unknown]

    @property
    def found(self) -> dict[str, object]:
        """The table `[simulation.found]`; empty without a number."""
        if not self.numbers:
            return {}
        return {
            "drives": list(self.drives),
            "found_on": date_of(wall_time_ns()).isoformat(),
            "numbers": {
                each.name: {
                    "value": rounded(each.interval.value),
                    "low": rounded(each.interval.low),
                    "high": rounded(each.interval.high),
                    "moves": {key: rounded(share) for key, share in each.moves.items()},
                }
                for each in self.numbers
            },
        }

    def entries(self, simulation: SimulationSettings) -> list[Entry]:
        """Return where [simulation] takes the numbers."""
        if not self.numbers:
            return []
        sets = {key: value for each in self.numbers for key, value in each.sets.items()}
        wheels = {key: sets.pop(key) for key in list(sets) if key.startswith("plant.wheels.")}
        entries = []
        if wheels and isinstance(simulation.plant, WheelsPlantSettings):
            entries.append(Entry("simulation.plant", "wheels", _wheel_rows(simulation.plant, wheels)))
        for key, value in sets.items():
            section, _, last = f"simulation.{key}".rpartition(".")
            entries.append(Entry(section, last, value))  # type: ignore[arg-type]
        return [*entries, Entry("simulation", "found", self.found)]


def twin_of(diagnosis: Diagnosis, config: Config) -> Twin | None:
    """Return the twin of the rover for the simulation of a configuration; None where it has none."""
    simulation = config.simulation
    if simulation is None:
        return None
    found: list[TwinNumber | Unknown] = [
        *_wheels(diagnosis, simulation.plant),
        _set_point_delay(diagnosis, simulation.plant),
        *_gyro(diagnosis, config, simulation),
        ground_of_slip(diagnosis.slip, simulation.plant),
        friction_of(diagnosis.drives, simulation.plant),
    ]
    others = [*config.roles.headings, *config.roles.fixes]
    why = "they are not separated from those of the rover"
    found += [Unknown(name=f"errors of {name}", why=why) for name in others]
    found = [_checked(each, simulation) if isinstance(each, TwinNumber) else each for each in found]
    return Twin(
        drives=[each.name for each in diagnosis.drives],
        numbers=[each for each in found if isinstance(each, TwinNumber)],
        unknown=[each for each in found if isinstance(each, Unknown)],
    )


def _checked(number: TwinNumber, simulation: SimulationSettings) -> TwinNumber | Unknown:
    """Return a number that [simulation] can state, with both ends of its interval."""
    interval = number.interval
    middle = rounded(interval.value)
    for value in (middle, rounded(interval.low), rounded(interval.high)):
        table = simulation.model_dump(exclude={"found"})
        for key, of_key in number.sets.items():
            place: Any = table
            *outer, last = [int(part) if part.isdigit() else part for part in key.split(".")]
            for part in outer:
                place = place[part] if isinstance(part, int) else place.setdefault(part, {})
            place[last] = of_key
        for key, share in number.moves.items():
            move(table, key, share * (value - middle))
        try:
            SimulationSettings.model_validate(table)
        except ValidationError:
            return Unknown(name=number.name, why=f"{number.words}, beyond the limits of [simulation]")
    return number


def _wheel_rows(plant: WheelsPlantSettings, sets: Mapping[str, object]) -> list[dict[str, object]]:
    rows = [wheel.model_dump(exclude_defaults=True, mode="json") for wheel in plant.wheels]
    for key, value in sets.items():
        _, _, place, last = key.split(".")
        if value != getattr(plant.wheels[int(place)], last):
            rows[int(place)][last] = value
    return rows


def _wheels(diagnosis: Diagnosis, plant: PlantSettings) -> Iterator[TwinNumber | Unknown]:
    """Yield the numbers of the wheels, as far as the drives show them and the simulated rover has them."""
    result = diagnosis.geometry.result
    why = diagnosis.geometry.reason if result is None else _problem(result)
    if result is None or why:
        yield Unknown(name="geometry of the wheels", why=why)
        return
    values_at = _values_at(result.geometry, plant)
    if values_at is None:
        yield Unknown(name="geometry of the wheels", why="the simulated rover has other wheels than [rover]")
        return
    fitted, sets = result.fit.values, values_at(result.fit.values)
    for each in result.shown:
        name = each.number.name
        moved = values_at({**fitted, name: fitted[name] + STEP})
        moves = {key: (moved[key] - value) / STEP for key, value in sets.items()}
        moves = {key: share for key, share in moves.items() if abs(share) > 1e-9}
        if not moves:
            yield Unknown(
                name=name, why="the simulated rover has no such number, or it follows from its ground"
            )
            continue
        low, high = each.value - each.half_width, each.value + each.half_width
        yield TwinNumber(
            name=name,
            unit="rad" if each.number.unit else "% of the described value",
            interval=Interval(value=each.value, low=low, high=high, count=result.fit.units),
            sets={key: rounded(value) for key, value in sets.items()},
            moves=moves,
        )
    for each in result.not_shown:
        yield Unknown(name=each.number.name, why=f"not shown; would show it: {each.number.shown_by}")


def _problem(result: GeometryResult) -> str:
    """Return why the numbers do not hold; "" also where they confirm the description."""
    is_right = result.errors and not result.differences and not any(each.is_worse for each in result.by_kind)
    is_plausible = all(abs(each.value) <= each.number.plausible for each in result.shown)
    return "" if result.shown and is_right and is_plausible else result.problem


def _values_at(
    geometry: Geometry, plant: PlantSettings
) -> Callable[[Mapping[str, float]], dict[str, float]] | None:
    """Return what gives the values of the simulated wheels by the numbers; None for other wheels.

    The track of wheels that skid in rotations is that of the description: the ground makes it wider.
    """
    rover = geometry.rover
    match plant:
        case WheelsPlantSettings() if len(geometry.wheels) == len(plant.wheels):
            plain = {"plant.wheel_radius_error": 0.0} if plant.wheel_radius_error else {}
            return lambda values: plain | _wheel_values(geometry, values)
        case RobotinoPlantSettings() if isinstance(rover, OmniRoverSettings):

            def omni(values: Mapping[str, float]) -> dict[str, float]:
                return {
                    "plant.wheel_radius_m": (1.0 + values.get(RADIUS, 0.0)) * rover.wheel_radius_m,
                    "plant.wheel_offset_m": (1.0 + values.get(BASE, 0.0)) * rover.base_radius_m,
                }

            return omni
        case ElDoradoPlantSettings() if isinstance(rover, SkidSteerRoverSettings):
            from sim_backends.terramechanics.soil.library import load_wheel  # scipy takes a second to load

            nominal_m = load_wheel(plant.wheel).radius_m
            return lambda values: {
                "plant.wheel_radius_error": (1.0 + values.get(RADIUS, 0.0)) * rover.wheel_radius_m / nominal_m
                - 1.0
            }
    return None


def _wheel_values(geometry: Geometry, values: Mapping[str, float]) -> dict[str, float]:
    skids = skids_in_turns(geometry.wheels)
    found = {}
    for place, wheel in enumerate(geometry_of(geometry.corrected(values)).wheels):
        found[f"plant.wheels.{place}.radius_m"] = wheel.radius_m
        if not skids:
            found[f"plant.wheels.{place}.x_m"] = wheel.x_m
            found[f"plant.wheels.{place}.y_m"] = wheel.y_m
            found[f"plant.wheels.{place}.angle_deg"] = wheel.angle_deg
    return found


def _set_point_delay(diagnosis: Diagnosis, plant: PlantSettings) -> TwinNumber | Unknown:
    name = "delay of the wheels"
    interval = mean_of(set_point_delays_s(diagnosis.drives), 0.0)
    if interval.count == 0:
        return Unknown(name=name, why="no setpoints are recorded, or no wheel follows them")
    return single(name, "s", interval, DELAYS[plant.type])


def _gyro(
    diagnosis: Diagnosis, config: Config, simulation: SimulationSettings
) -> Iterator[TwinNumber | Unknown]:
    device = config.roles.gyro
    if device is None:
        return
    emulator = simulation.devices.get(device)
    if emulator is None:
        emulator = EMULATOR.validate_python({"type": config.devices[device].type})
    recorded = diagnosis.drives[0].drive.config
    sensor = recorded.devices.get(recorded.roles.gyro or "")
    if not isinstance(emulator, InertialErrorSettings) or not isinstance(sensor, InertialSettings):
        yield Unknown(name=f"errors of {device}", why="it is no inertial sensor of its own")
        return
    place = f"devices.{device}"
    noise = mean_of(gyro_noises_rad_s(diagnosis.drives, emulator.rate_hz), 0.0)
    numbers = [single("gyro noise", "deg/s", _degrees(noise), f"{place}.gyro_noise_deg_s")]
    result = diagnosis.geometry.result
    numbers += _gyro_errors(None if result is None else result.gyro, sensor, place)
    numbers.append(_gyro_delay(diagnosis, place))
    for each in numbers:
        # An emulator without an entry has the default errors.
        yield (
            replace(each, sets={f"{place}.type": emulator.type, **each.sets})
            if isinstance(each, TwinNumber)
            else each
        )


def _degrees(interval: Interval) -> Interval:
    return interval.times(math.degrees(1.0))


def _gyro_errors(gyro: GyroFit | None, sensor: InertialSettings, place: str) -> list[TwinNumber | Unknown]:
    """Return bias and scale, of the readings as the sensor sends them."""
    if gyro is None:
        why = "these drives have no gyro, or no known places to compare it with"
        return [Unknown(name=name, why=why) for name in ("gyro bias", "gyro scale")]
    mounting = sensor.make_mounting()
    found: list[TwinNumber | Unknown] = []
    if sensor.mounting_roll_deg or sensor.mounting_pitch_deg:
        found.append(Unknown(name="gyro bias", why="the sensor is not mounted level"))
    else:
        raw = (gyro.bias_rad_s + mounting.gyro_bias_rad_s) / mounting.gyro_scale
        # Each drive has another bias: that of the next one is wanted.
        bias = mean_of([[value] for value in raw.tolist()], is_of_next=True)
        found.append(single("gyro bias", "deg/s", _degrees(bias), f"{place}.gyro_bias_deg_s"))
    if not gyro.is_shown:
        return [
            *found,
            Unknown(name="gyro scale", why="not shown; drive rotations to both sides, with pauses"),
        ]
    value, half = mounting.gyro_scale / gyro.scale, mounting.gyro_scale * gyro.half_width / gyro.scale**2
    scale = Interval(value=value, low=value - half, high=value + half, count=len(gyro.bias_rad_s))
    return [*found, single("gyro scale", "% of the reading", scale, f"{place}.gyro_scale")]


def _gyro_delay(diagnosis: Diagnosis, place: str) -> TwinNumber | Unknown:
    name, interval = "gyro delay", mean_of(gyro_delays_s(diagnosis.drives))
    if interval.is_known and interval.high < 0.0:
        why = f"the wheels are later: {interval.words('s')}; simulated wheels report at once"
        return Unknown(name=name, why=why)
    if interval.is_known and interval.low <= 0.0:
        return Unknown(name=name, why=f"none is shown beside the wheels: {interval.words('s')}")
    return single(name, "s", interval, f"{place}.rate_delay_s")
