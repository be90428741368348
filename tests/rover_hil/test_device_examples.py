"""Every type of device has an example configuration that drives, and is known everywhere it must be."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from benchmarks.program.fuzz_parsers import BLOCK, PARSERS, fuzz
from drivers.device_settings import FrameDeviceSettings
from drivers.registry import AnyDeviceSettings
from rover_hil.config import load_config, shipped_configs
from rover_hil.doctor.devices.rejections import _UNKNOWN, advice_for
from rover_hil.recording.reader import LogReader
from rover_hil.run.checks import VIRTUAL_RUN_CHECKS
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import End
from sim_backends.settings import EmulatorSettings

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
SETTINGS = get_args(get_args(AnyDeviceSettings)[0])
TYPES = {get_args(settings.model_fields["type"].annotation)[0]: settings for settings in SETTINGS}
OTHER_GEOMETRIES = {"six_wheels", "mecanum"}
"""Their devices are those of another example."""
NEEDS_AN_OVERHEAD_SCENE = {"overhead_camera"}
"""Described in docs/how-to/fit_slip_maps.md."""


def health_of(path: Path) -> dict[str, dict[str, object]]:
    """Return the last health record of each device."""
    *_, last = (message.json() for message in LogReader(path).messages() if message.topic == "/health")
    assert isinstance(last, list)
    return {record["device"]: record for record in last}


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=pytest.mark.nightly, id=path.stem)
        if path.stem in OTHER_GEOMETRIES
        else pytest.param(path, id=path.stem)
        for path in sorted(EXAMPLES.glob("*.toml"))
    ],
)
def test_an_example_drives_and_its_devices_are_healthy(path: Path, tmp_path: Path) -> None:
    config = load_config(str(path), VIRTUAL_RUN_CHECKS)
    log = tmp_path / "run.mcap"
    result = run_virtual(config, log, config.loop.time_limit_s, None)
    assert result.end is End.FINISHED
    health = health_of(log)
    assert set(health) == set(config.devices)
    assert {name: record["rejected"] for name, record in health.items()} == {name: {} for name in health}
    assert {record["breaks"] for record in health.values()} == {0}


def test_every_type_of_device_is_in_an_example() -> None:
    named = [*shipped_configs(), *map(str, EXAMPLES.glob("*.toml"))]
    used = {device.type for name in named for device in load_config(name).devices.values()}
    assert used == set(TYPES) - NEEDS_AN_OVERHEAD_SCENE


def test_errors_of_every_type_of_device_can_be_configured() -> None:
    emulators = get_args(get_args(EmulatorSettings)[0])
    assert {get_args(emulator.model_fields["type"].annotation)[0] for emulator in emulators} == set(TYPES)


@pytest.mark.parametrize("parser", PARSERS)
def test_the_doctor_explains_every_rejection_of_a_fuzzed_device(parser: str) -> None:
    codec, seeds = PARSERS[parser]()
    reasons = set(fuzz(codec, seeds, 3 * BLOCK, np.random.default_rng(3)).rejected)
    (device_type,) = (name for name in TYPES if parser == name or parser.startswith(f"{name}_"))
    assert {reason for reason in reasons if advice_for(reason, device_type) == _UNKNOWN} == set()


def test_every_device_of_bytes_is_fuzzed() -> None:
    byte_types = {name for name, settings in TYPES.items() if not issubclass(settings, FrameDeviceSettings)}
    assert {name for name in byte_types if not any(parser.startswith(name) for parser in PARSERS)} == set()
