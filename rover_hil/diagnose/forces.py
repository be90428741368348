"""Forces of the simulated twin: the ground by the slip of straights, the wheels' friction by their motors."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import wheels_reach_m
from rover_hil.diagnose.intervals import Interval, mean_of
from rover_hil.diagnose.replayed_drive import ReplayedDrive
from rover_hil.diagnose.twin_number import TwinNumber, Unknown, rounded, single
from rover_hil.drives.arrays import Array, Flags
from rover_hil.ready.wheels.motion_kinds import BY_HAND, CIRCLE, SQUARE, STRAIGHT
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.wheels.settings import PlantWheel, WheelMotor, WheelsPlantSettings
from sim_backends.settings import PlantSettings

GROUND = "found"
"""Name of the site and of its surface."""
LEAST_READINGS = 50
WINDOW_S = 1.0
STEADY = 0.05
"""In a steady window on a straight, speed and course change by less than this share."""
LEAST_SPEED = 0.5
"""Slower windows than this share of the greatest speed are none of a steady drive."""
FRICTION = "friction of a wheel"

Powers = Callable[[Array, Array, Array], Array]
"""Power of the friction of all wheels over the sum of their speeds, in the unit of the simulation, by the
currents and speeds of the wheels, each (n, wheels), and the velocity of the body ahead and left, (n, 2)."""


def ground_of_slip(slips: Mapping[str, Interval], plant: PlantSettings) -> TwinNumber | Unknown:
    """Return the slip along the path, which gives the stiffness of the ground.

    A wheel on a straight transmits what resists the motion of the rover, `pull` over its load. The simulated
    ground answers a slip s with stiffness s / sqrt(1 + (stiffness s / friction)^2).
    """
    name = "slip"
    if not isinstance(plant, WheelsPlantSettings) or any(
        wheel.roller_deg is not None for wheel in plant.wheels
    ):
        return Unknown(
            name=name, why="the ground stays: its formula is that of wheels without rollers on a floor"
        )
    kind = next((each for each in (STRAIGHT, CIRCLE, SQUARE, BY_HAND) if each in slips), "")
    if not kind:
        return Unknown(name=name, why="it needs ground truth with yaw")
    slip = slips[kind]
    if not slip.is_known or slip.low <= 0.0:
        return Unknown(
            name=name,
            why=f"the ground stays: none is shown on a {kind}: {slip.times(100.0).words('% of the travel')}",
        )
    surface = plant.site.surfaces[plant.site.floor]
    pull = pull_of(plant, surface.drag_along)
    if pull >= surface.friction:
        return Unknown(name=name, why="the ground stays: on it the simulated rover would not move")
    value = pull / (slip.value * math.sqrt(1.0 - (pull / surface.friction) ** 2))
    surfaces = {GROUND: {**surface.model_dump(), "stiffness": rounded(value)}}
    site = {"name": GROUND, "floor": GROUND, "surfaces": surfaces}
    return TwinNumber(
        name=name,
        unit="% of the travel",
        interval=slip,
        sets={"plant.site": site},
        moves={f"plant.site.surfaces.{GROUND}.stiffness": -value / slip.value},
    )


def pull_of(plant: WheelsPlantSettings, drag: float) -> float:
    """Return the resistance of the whole rover over the load of the wheels that are driven."""
    from sim_backends.plants.wheels.plant import make_rover  # numba takes a second to load

    load_n: list[float] = make_rover(plant).load_n.tolist()
    on_wheels, on_castors = load_n[: len(plant.wheels)], load_n[len(plant.wheels) :]
    resistance_n = drag * sum(on_wheels)
    resistance_n += sum(each.drag * load for each, load in zip(plant.castors, on_castors, strict=True))
    return resistance_n / sum(load for each, load in zip(plant.wheels, on_wheels, strict=True) if each.driven)


def friction_of(drives: Sequence[ReplayedDrive], plant: PlantSettings) -> TwinNumber | Unknown:
    """Return the Coulomb friction of a wheel with which the simulated motors take the recorded currents.

    On a steady straight of level ground the power of the motors is that of friction and of the ground's
    resistance. Torque per current and ground are those of the simulation. That the ground is level is not
    tested: a slope that all drives climb counts as friction, one that they drive up and down cancels.
    """
    counts = {make_kinematics(each.drive.config.rover).wheel_count for each in drives}
    match plant:
        case WheelsPlantSettings() if counts != {len(plant.wheels)}:
            return Unknown(name=FRICTION, why="the simulated rover has other wheels than [rover]")
        case WheelsPlantSettings() if all(wheel.roller_deg is None for wheel in plant.wheels):
            key, friction = "plant.wheel_friction_nm", _of_wheels(plant)
            torque_per_a = float(np.mean([_torque_per_a(wheel) for wheel in plant.wheels if wheel.driven]))
        case RobotinoPlantSettings():
            key, friction = "plant.motor.friction_nm", _of_robotino(plant)
            torque_per_a = plant.motor.torque_constant_nm_per_a
        case _:
            return Unknown(name=FRICTION, why="the resistance of the simulated ground has no formula here")
    if plant.site.patches:
        return Unknown(
            name=FRICTION,
            why="the drag of the simulated ground differs by place: give the simulation the ground of these "
            'drives, e.g. site = "floor_table"',
        )
    at = f"with {torque_per_a:.2g} N m/A"
    # Steady windows of one drive have errors in common.
    windows = [one for one in (_frictions(each, friction) for each in drives) if one]
    found = mean_of([[float(np.mean(one))] for one in windows])
    if found.count == 0:
        return Unknown(name=FRICTION, why="no motor currents are recorded on a steady straight")
    if found.high <= 0.0:
        return Unknown(
            name=FRICTION,
            why=f"the simulated ground alone takes more than the motors give {at}: correct one of them",
        )
    return single(
        FRICTION, f"N m {at}", replace(found, low=max(found.low, 0.0), value=max(found.value, 0.0)), key
    )


def _frictions(each: ReplayedDrive, friction: Powers) -> list[float]:
    """Return the friction of each steady window of a drive."""
    channels, replay = each.drive.channels, each.replay
    kinematics = make_kinematics(each.drive.config.rover)
    wheels = range(1, kinematics.wheel_count + 1)
    driven = [wheel for wheel in wheels if wheel - 1 not in kinematics.undriven]
    if any(len(channels[f"current{wheel}_a"]) < LEAST_READINGS for wheel in driven):
        return []
    edges_s = np.arange(replay.t_s[0], replay.t_s[-1], 0.5 * WINDOW_S)
    start_ns = each.drive.log.start_ns
    speed, current = np.zeros((2, len(edges_s) - 1, len(wheels)))
    for place, wheel in enumerate(wheels):
        angle, size = channels[f"position{wheel}_rad"], channels[f"current{wheel}_a"]
        at_s = (angle.t_ns - start_ns) / 1e9
        speed[:, place] = np.diff(np.interp(edges_s, at_s, angle.value)) / np.diff(edges_s)
        if wheel in driven:
            current[:, place] = _means(edges_s, (size.t_ns - start_ns) / 1e9, size.value)
            if wheel in channels.unsigned_wheels:
                current[:, place] *= np.sign(speed[:, place])
    path = replay.at(edges_s, replay.odometry)
    assert path.yaw_rad is not None  # noqa: S101 the wheels have one
    step_m = np.diff(path.place_m) * np.exp(-0.5j * (path.yaw_rad[1:] + path.yaw_rad[:-1]))
    is_steady = _are_steady(step_m, np.diff(path.yaw_rad), wheels_reach_m(each.drive.config.rover))
    velocity = np.column_stack((step_m.real, step_m.imag)) / (0.5 * WINDOW_S)
    found: list[float] = friction(*(_pairs(one)[is_steady] for one in (current, speed, velocity))).tolist()
    return found


def _means(edges_s: Array, t_s: Array, value: Array) -> Array:
    """Return the mean of a signal between times."""
    area = np.concatenate(([0.0], np.cumsum(0.5 * (value[1:] + value[:-1]) * np.diff(t_s))))
    means: Array = np.diff(np.interp(edges_s, t_s, area)) / np.diff(edges_s)
    return means


def _pairs(halves: Array) -> Array:
    """Return the means over windows by those over their halves."""
    whole = len(halves) // 2 * 2
    means: Array = 0.5 * (halves[0:whole:2] + halves[1:whole:2])
    return means


def _are_steady(step_m: NDArray[np.complex128], turn_rad: Array, reach_m: float) -> Flags:
    """Return which windows are straight and of constant speed, by the motion in each half of them."""
    whole = len(step_m) // 2 * 2
    before, after = step_m[0:whole:2], step_m[1:whole:2]
    way_m = np.abs(before + after)
    rim_m = reach_m * (np.abs(turn_rad[0:whole:2]) + np.abs(turn_rad[1:whole:2]))
    is_fast = way_m > LEAST_SPEED * float(way_m.max(initial=0.0))
    return is_fast & (np.abs(after - before) < STEADY * way_m) & (rim_m < STEADY * way_m)


def _of_wheels(plant: WheelsPlantSettings) -> Powers:
    """Return the mean friction of the wheels at the wheel."""
    from sim_backends.plants.wheels.plant import make_rover  # numba takes a second to load

    rover = make_rover(plant)
    torque_per_a = np.array([_torque_per_a(wheel) for wheel in plant.wheels])
    surface = plant.site.surfaces[plant.site.floor]
    count = len(plant.wheels)
    drag = [*[surface.drag_along] * count, *[castor.drag for castor in plant.castors]]
    resistance_n = float(np.dot(rover.load_n, drag))

    def friction(current: Array, speed: Array, velocity: Array) -> Array:
        power_w = (current * speed) @ torque_per_a - resistance_n * np.hypot(*velocity.T)
        found: Array = power_w / np.abs(speed).sum(axis=1)
        return found

    return friction


def _torque_per_a(wheel: PlantWheel) -> float:
    motor = wheel.motor or WheelMotor()
    return motor.stall_torque_nm / motor.stall_current_a


def _of_robotino(plant: RobotinoPlantSettings) -> Powers:
    """Return the mean friction of the motors, before their gears."""
    from sim_backends.plants.robotino.plant import make_rover  # numba takes a second to load

    rover, motor = make_rover(plant, 1e-3), plant.motor
    surface = plant.site.surfaces[plant.site.floor]

    def friction(current: Array, speed: Array, velocity: Array) -> Array:
        given = (rover.torque_nm_per_a * current - rover.viscous_nm_s * speed) * speed
        ahead, aside = velocity @ rover.direction[:, :2].T, velocity @ rover.radial[:, :2].T
        size = np.maximum(np.hypot(ahead, aside), 1e-9)
        lost = rover.load_n * (surface.drag_along * ahead**2 + surface.drag_across * aside**2) / size
        power_w = (rover.gear_efficiency * given - lost).sum(axis=1)
        found: Array = power_w / np.abs(speed).sum(axis=1) / (motor.gear_ratio * motor.gear_efficiency)
        return found

    return friction
