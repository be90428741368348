"""Worlds built from settings, driven through the drivers of the real devices."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from drivers.clock import VirtualClock, nanoseconds
from drivers.device_settings import FrameDeviceSettings
from drivers.driver import Driver, WheelDrive
from drivers.errors import ConfigError
from drivers.registry import AnyDeviceSettings
from drivers.samples import FrameSample, HeadingSample, RateSample, Sample, WheelCommand, WheelSample
from sim_backends import build
from sim_backends.build import build_world, check_world
from sim_backends.settings import SimulationSettings, emulator_of
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.world import World

START_NS = 1_000_000_000

DEVICES: dict[str, dict[str, object]] = {
    "board": {"type": "robotino_board", "port": "ports/board"},
    "can": {"type": "can_wheels", "interface": "slcan", "channel": "ports/can", "mapping": "generic_wheel"},
    "compass": {"type": "nmea_compass", "port": "ports/compass"},
    "imu": {"type": "witmotion", "port": "ports/imu"},
    "camera": {
        "type": "camera",
        "source": "live_folder",
        "path": "ports/camera",
        "width": 160,
        "height": 120,
        "frame_rate_hz": 5,
    },
}
PLANTS = {"board": {"type": "robotino"}, "can": {"type": "el_dorado"}}


def devices(*names: str) -> Mapping[str, AnyDeviceSettings]:
    adapter: TypeAdapter[AnyDeviceSettings] = TypeAdapter(AnyDeviceSettings)
    return {name: adapter.validate_python(DEVICES[name]) for name in names}


def world(*names: str, **simulation: object) -> World:
    table = {"plant": PLANTS[names[0]], **simulation}
    return build_world(devices(*names), SimulationSettings.model_validate(table), START_NS)


@contextmanager
def connected(
    rover: World, names: tuple[str, ...]
) -> Iterator[tuple[VirtualClock, dict[str, Driver[bytes]]]]:
    clock = VirtualClock(START_NS)
    drivers: dict[str, Driver[bytes]] = {}
    for name, settings in devices(*names).items():
        assert not isinstance(settings, FrameDeviceSettings)
        link = LoopbackLink(rover, rover.byte_devices[name], clock)
        drivers[name] = settings.make_driver(name, link, clock)
        drivers[name].connect()
    yield clock, drivers
    for driver in drivers.values():
        driver.close()


def drive(
    rover: World, names: tuple[str, ...], speed_rad_s: tuple[float, ...], duration_s: float
) -> list[Sample]:
    """Command the first device and return what all devices say."""
    samples: list[Sample] = []
    with connected(rover, names) as (clock, drivers):
        drive_device = drivers[names[0]]
        assert isinstance(drive_device, WheelDrive)
        while clock.now_ns() < START_NS + nanoseconds(duration_s):
            for driver in drivers.values():
                samples.extend(driver.poll())
            now_ns = clock.now_ns()
            drive_device.command(WheelCommand(t_ns=now_ns, expires_ns=now_ns + 1, speed_rad_s=speed_rad_s))
            clock.sleep_until(now_ns + 20_000_000)
    return samples


ROBOTINO = ("board", "imu")
FOUR_WHEELS = ("can", "compass", "imu")


@pytest.mark.parametrize(
    ("names", "speed_rad_s"), [(ROBOTINO, (-4.0, 0.0, 4.0)), (FOUR_WHEELS, (1.0, 1.0, 1.0, 1.0))]
)
def test_a_rover_drives_and_its_devices_report_it(
    names: tuple[str, ...], speed_rad_s: tuple[float, ...]
) -> None:
    rover = world(*names, seed=1)
    samples = drive(rover, names, speed_rad_s, 3.0)
    truth = rover.plant.truth()
    assert truth.x_m > 0.2
    last = {s.wheel: s for s in samples if isinstance(s, WheelSample) and s.position_rad is not None}
    for wheel, position_rad in enumerate(truth.wheel_position_rad):
        assert last[wheel].position_rad == pytest.approx(position_rad, abs=0.2)
    assert {sample.device for sample in samples} == set(names)
    assert any(isinstance(sample, RateSample) for sample in samples)
    assert any(isinstance(sample, HeadingSample) for sample in samples) or "compass" not in names


def test_a_camera_is_built_beside_the_byte_devices() -> None:
    rover = world("can", "camera")
    assert set(rover.byte_devices) == {"can"}
    settings = devices("camera")["camera"]
    assert settings.type == "camera"
    clock = VirtualClock(START_NS)
    link = LoopbackLink(rover, rover.image_devices["camera"], clock)
    with settings.make_driver("camera", link, clock) as camera:
        assert camera.wait_next(FrameSample, 1.0).image.shape[:2] == (120, 160)


def test_a_seed_gives_one_run_and_another_seed_another() -> None:
    runs = [drive(world(*ROBOTINO, seed=seed), ROBOTINO, (-4.0, 0.0, 4.0), 1.0) for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]


def test_a_seed_means_the_same_in_every_process(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = {}
    known = emulator_of

    def note(kind: str) -> Any:
        def make(
            name: str, settings: Any, errors: Any, plant: Any, rng: np.random.Generator, start_ns: int
        ) -> Any:
            drawn[name] = int(rng.integers(1_000_000))
            return known(kind)(name, settings, errors, plant, rng, start_ns)

        return make

    monkeypatch.setattr(build, "emulator_of", note)
    world(*ROBOTINO, seed=1)
    assert drawn["board"] == 370_421


def test_two_devices_of_a_kind_do_not_share_their_noise() -> None:
    settings = devices("compass")["compass"]
    simulation = SimulationSettings.model_validate({"plant": {"type": "robotino"}})
    rover = build_world({"left": settings, "right": settings}, simulation, START_NS)
    rover.advance(START_NS + nanoseconds(2.0))
    left, right = (rover.byte_devices[name].to_host.take(2 * START_NS + 1) for name in ("left", "right"))
    assert [item.payload for item in left] != [item.payload for item in right]


def test_another_device_changes_nothing_for_the_others() -> None:
    alone = drive(world("can", seed=1), ("can",), (1.0,) * 4, 1.0)
    together = drive(world("can", "compass", seed=1), ("can", "compass"), (1.0,) * 4, 1.0)
    assert alone == [sample for sample in together if sample.device == "can"]


def test_devices_err_as_the_settings_say() -> None:
    errors = {"compass": {"type": "nmea_compass", "bias_deg": 30.0}}
    headings = []
    for simulation in ({}, {"devices": errors}):
        rover = world("can", "compass", **simulation)
        with connected(rover, ("compass",)) as (_, drivers):
            headings.append(drivers["compass"].wait_next(HeadingSample, 1.0).heading_rad)
    assert abs(headings[1] - headings[0]) == pytest.approx(29.5 / 57.3, abs=0.01)


def test_faults_befall_their_device_only() -> None:
    fault = {"type": "unplug", "device": "imu", "start_s": 1.0, "duration_s": 5.0}
    samples = drive(world(*ROBOTINO, faults=[fault]), ROBOTINO, (-4.0, 0.0, 4.0), 3.0)
    last_s = {sample.device: (sample.t_ns - START_NS) / 1e9 for sample in samples}
    assert last_s["imu"] == pytest.approx(1.0, abs=0.05)
    assert last_s["board"] == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize(
    ("names", "simulation", "message"),
    [
        (
            ("board",),
            {"devices": {"imu": {"type": "witmotion"}}},
            r"simulation.devices.imu: .* no 'imu': .* board",
        ),
        (
            ("board",),
            {"devices": {"board": {"type": "witmotion"}}},
            r"devices.board.type: must be 'robotino_board'",
        ),
        (
            ("board",),
            {"faults": [{"type": "freeze", "device": "x", "start_s": 0, "duration_s": 1}]},
            r"simulation.faults.0.device: .* no 'x'",
        ),
        (("board",), {"plant": {"type": "el_dorado"}}, "3 wheels"),
        (("can",), {"plant": {"type": "robotino"}}, "wheel"),
        (
            ("can", "camera"),
            {"devices": {"camera": {"type": "camera", "tilt_deg": 5.0}}},
            "views ground more than",
        ),
        (
            ("can", "compass"),
            {"devices": {"compass": {"type": "nmea_compass", "rate_hz": 50.0}}},
            "raise baud_rate or lower rate_hz",
        ),
    ],
)
def test_what_does_not_fit_is_a_config_error_of_the_world_and_of_its_check(
    names: tuple[str, ...], simulation: dict[str, object], message: str
) -> None:
    with pytest.raises(ConfigError, match=message) as built:
        world(*names, **simulation)
    settings = SimulationSettings.model_validate({"plant": PLANTS[names[0]], **simulation})
    with pytest.raises(ConfigError) as checked:
        check_world(devices(*names), settings)
    assert str(checked.value) == str(built.value)


def test_a_check_compiles_nothing_and_makes_no_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("sim_backends.plants.el_dorado.plant.settle", refuse)
    monkeypatch.setattr("sim_backends.rear_scene.emulated_scene.RearScene", refuse)
    names = ("can", "compass", "imu", "camera")
    settings = SimulationSettings.model_validate({"plant": PLANTS["can"]})
    check_world(devices(*names), settings)
    with pytest.raises(AssertionError):
        world(*names)


@pytest.mark.parametrize(
    "plant",
    [
        {"type": "hovercraft"},
        {"type": "robotino", "ground": {}},
        {"type": "robotino", "site": "floor_of_lava"},
        {"type": "el_dorado", "ground": {"inclination_deg": float("nan")}},
    ],
)
def test_a_plant_that_makes_no_sense_is_refused(plant: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        SimulationSettings.model_validate({"plant": plant})
