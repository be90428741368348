"""Whether the emulator of a device fits its line and the simulated rover."""

from drivers.errors import ConfigError
from sim_backends.world.plant import Plant


def check_bit_rate(name: str, required_bits_s: float, bit_rate: float, fix: str) -> None:
    """Check that a line carries what a simulated device sends.

    Raises:
        ConfigError: It does not; ends with `fix`.
    """
    if required_bits_s > bit_rate:
        raise ConfigError(
            f"simulated device '{name}' needs {required_bits_s:.0f} bit/s, its line has {bit_rate:.0f}: {fix}"
        )


def check_wheel_count(name: str, wheel_count: int, plant: Plant) -> None:
    """Check that a device turns as many wheels as the simulated rover has.

    Raises:
        ConfigError: It does not.
    """
    if wheel_count != plant.wheel_count:
        raise ConfigError(
            f"simulated device '{name}' turns {wheel_count} wheels but the simulated rover has "
            f"{plant.wheel_count}: change one"
        )
