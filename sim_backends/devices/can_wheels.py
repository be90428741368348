"""The simulated wheel drives on a CAN bus; what reads DBC files is loaded when they are made."""

import numpy as np

from drivers.can_wheels.settings import CanWheelsSettings
from sim_backends.devices.can_node_settings import CanNodeSettings
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice


def make_emulator(
    name: str,
    device: CanWheelsSettings,
    emulator: CanNodeSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Build the emulated drives and the two directions of their bus.

    Raises:
        ConfigError: The mapping is wrong, does not fit the plant, or needs more than the bus can carry.
    """
    from sim_backends.devices.can_nodes import make_can_node  # what reads DBC files takes half a second

    return make_can_node(name, device, emulator, plant, rng, start_ns)
