"""Models of the machines of tests/nature/machines, written from their data sheet."""

from collections.abc import Callable

from benchmarks.gap_machines.models import circuit, geared_axis, pendulum, tanks, thermal, vehicle
from rover_hil.gap import StateModel

MODELS: dict[str, Callable[[], StateModel]] = {
    "geared_axis": geared_axis.make_model,
    "pendulum": pendulum.make_model,
    "tanks": tanks.make_model,
    "thermal": thermal.make_model,
    "circuit": circuit.make_model,
    "vehicle": vehicle.make_model,
}
