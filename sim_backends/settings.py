"""Settings of the simulated rover: [simulation]."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, Protocol, Self, TypeAlias, Union, get_args, get_type_hints

from pydantic import Field, model_validator

from drivers.device_settings import DeviceSettings
from drivers.registry import device_types
from drivers.settings import Settings
from sim_backends.found import FoundNumber, FoundSettings, move
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.world.faults import FaultSettings
from sim_backends.world.world import EmulatedDevice

PlantSettings: TypeAlias = Annotated[
    RobotinoPlantSettings | ElDoradoPlantSettings | WheelsPlantSettings, Field(discriminator="type")
]


def emulator_of(device_type: str) -> Callable[..., EmulatedDevice[Any]]:
    """Return what makes the emulator of a type of device: `make_emulator` in the file of its name."""
    make: Callable[..., EmulatedDevice[Any]] = import_module(
        f"sim_backends.devices.{device_type}"
    ).make_emulator
    return make


def _settings_of(device: type[DeviceSettings]) -> type[Settings]:
    """Return the settings of the emulator of a device, which its `make_emulator` takes."""
    (device_type,) = get_args(device.model_fields["type"].annotation)
    settings: type[Settings] = get_type_hints(emulator_of(device_type))["emulator"]
    return settings


if TYPE_CHECKING:

    class EmulatorSettings(Protocol):
        """Errors of a simulated device."""

        @property
        def type(self) -> str:
            """The type of the device."""
else:
    EmulatorSettings = Annotated[
        Union[tuple(_settings_of(device) for device in device_types())],  # noqa: UP007
        Field(discriminator="type"),
    ]


class SimulationSettings(Settings):
    """The simulated rover, the errors of its devices, and what goes wrong.

    Attributes:
        seed: Seed of all random numbers; the same seed gives the same run.
        plant: The true rover and its ground.
        devices: Errors of the devices in [devices], by name; a device without an entry has the default
            errors.
        faults: What fails, and when.
        found: What recorded drives have shown of this rover; none for a rover that was not diagnosed.
    """

    seed: Annotated[int, Field(ge=0)] = 0
    plant: PlantSettings
    devices: dict[str, EmulatorSettings] = Field(default_factory=dict)
    faults: tuple[FaultSettings, ...] = ()
    found: FoundSettings | None = None

    def with_numbers(self, numbers: Mapping[str, float]) -> dict[str, Any]:
        """Return this section, not yet checked, for a rover of which found numbers have other values.

        Args:
            numbers: By the name that they have in `found`.
        """
        table = self.model_dump()
        for name, value in numbers.items():
            number = self.found_numbers[name]
            for key, share in number.moves.items():
                move(table, key, share * (value - number.value))
        return table

    @property
    def found_numbers(self) -> Mapping[str, FoundNumber]:
        """The numbers that recorded drives have shown, by name."""
        return {} if self.found is None else self.found.numbers

    @model_validator(mode="after")
    def _check_found(self) -> Self:
        table = self.model_dump() if self.found is not None else {}
        for number in self.found_numbers.values():
            for key in number.moves:
                move(table, key, 0.0)
        return self
