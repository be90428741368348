"""All machines."""

from tests.nature.hidden_machines.kinds import (
    boat,
    chamber,
    conveyor,
    crane,
    cylinder,
    drone,
    elevator,
    gearbox,
    heater,
    ladder,
    pump,
    sand_wheel,
    skid_rover,
    table,
    valve,
)
from tests.nature.hidden_machines.machine import Machine

MACHINES: tuple[Machine, ...] = (
    boat.MACHINE,
    chamber.MACHINE,
    conveyor.MACHINE,
    crane.MACHINE,
    cylinder.MACHINE,
    drone.MACHINE,
    elevator.MACHINE,
    gearbox.MACHINE,
    heater.MACHINE,
    ladder.MACHINE,
    pump.MACHINE,
    sand_wheel.MACHINE,
    skid_rover.MACHINE,
    table.MACHINE,
    valve.MACHINE,
)
