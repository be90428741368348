"""A device on a bench: its driver and its emulator joined by some backend, and a way to let time pass."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from drivers.can.frame import CanFrame, pack_can_frame
from drivers.clock import Clock, SystemClock, VirtualClock, nanoseconds
from drivers.device_settings import FrameDeviceSettings
from drivers.driver import AnyDriver, WheelDrive
from drivers.link import CameraImage, LinkItem, NoTap
from drivers.registry import AnyDeviceSettings
from drivers.samples import (
    BumperSample,
    FrameSample,
    HeadingSample,
    PoseFixSample,
    PowerSample,
    RateSample,
    Sample,
    WheelCommand,
    WheelSample,
)
from sim_backends.build import build_world
from sim_backends.serving.server import Server, put_on_ports
from sim_backends.settings import SimulationSettings
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.world import World

ADAPTER: TypeAdapter[AnyDeviceSettings] = TypeAdapter(AnyDeviceSettings)
NAME = "device"
STEP_S = 0.02


@dataclass(frozen=True)
class Case:
    """One device type: its settings for a port in a folder, the plant it sits on, what it must say.

    Attributes:
        says: Kinds of samples that must come within a second.
        garbage: A payload that must be rejected and counted.
    """

    device_type: str
    plant: str
    settings: Callable[[Path], dict[str, object]]
    says: tuple[type[Sample], ...]
    garbage: bytes | CameraImage


CASES = (
    Case(
        "robotino_board",
        "robotino",
        lambda folder: {"port": str(folder / "port")},
        (WheelSample,),
        b"RECxxxxrec",
    ),
    Case(
        "robotino3_board",
        "robotino",
        lambda folder: {"port": str(folder / "port")},
        (WheelSample, BumperSample, PowerSample),
        bytes.fromhex("aa 02 00 34 00 cb ff"),
    ),
    Case(
        "can_wheels",
        "el_dorado",
        lambda folder: {"interface": "slcan", "channel": str(folder / "port"), "mapping": "generic_wheel"},
        (WheelSample,),
        pack_can_frame(CanFrame(0x7FF, b"\x01")),
    ),
    Case(
        "canopen_wheels",
        "el_dorado",
        lambda folder: {
            "interface": "slcan",
            "channel": str(folder / "port"),
            "wheel": [{"node": node} for node in (1, 2, 3, 4)],
            "counts_per_motor_turn": 4096,
            "gear_ratio": 50.0,
        },
        (WheelSample,),
        pack_can_frame(CanFrame(0x189, bytes(6))),
    ),
    Case(
        "vesc",
        "el_dorado",
        lambda folder: {
            "interface": "slcan",
            "channel": str(folder / "port"),
            "wheel": [{"node": node} for node in (1, 2, 3, 4)],
            "pole_pairs": 7,
            "gear_ratio": 20.0,
        },
        (WheelSample,),
        pack_can_frame(CanFrame(0x909, bytes(8), is_extended=True)),
    ),
    Case(
        "nmea_compass",
        "el_dorado",
        lambda folder: {"port": str(folder / "port")},
        (HeadingSample,),
        b"$HCHDG,*00\r\n",
    ),
    Case(
        "nmea_gnss",
        "el_dorado",
        lambda folder: {"port": str(folder / "port"), "baud_rate": 38400, "max_age_s": 0.5},
        (PoseFixSample,),
        b"$GNGGA,*00\r\n",
    ),
    Case("witmotion", "el_dorado", lambda folder: {"port": str(folder / "port")}, (RateSample,), bytes(11)),
    Case(
        "vectornav",
        "el_dorado",
        lambda folder: {"port": str(folder / "port")},
        (RateSample, HeadingSample),
        b"$VNYMR,1*00\r\n",
    ),
    Case(
        "xsens",
        "el_dorado",
        lambda folder: {"port": str(folder / "port")},
        (RateSample, HeadingSample),
        bytes.fromhex("fa ff 36 03 80 20 0c 55"),
    ),
    Case(
        "camera",
        "el_dorado",
        lambda folder: {
            "source": "live_folder",
            "path": str(folder / "port"),
            "width": 64,
            "height": 48,
            "frame_rate_hz": 10,
        },
        (FrameSample,),
        CameraImage(np.zeros((8, 8, 3), np.uint8), 1_500_000_000),
    ),
    Case(
        "overhead_camera",
        "robotino",
        lambda folder: {
            "source": "live_folder",
            "path": str(folder / "port"),
            "frame_rate_hz": 10,
            "marker_id": 7,
            "marker_size_m": 0.12,
            "marker_height_m": 0.22,
            "calibration": "simulated",
            "max_age_s": 0.5,
        },
        (PoseFixSample,),
        CameraImage(np.zeros((480, 640, 3), np.uint8), 1_500_000_000),
    ),
)


class KeepingTap(NoTap):
    """Keeps what arrived, in order."""

    def __init__(self) -> None:
        self.items: list[LinkItem[bytes] | LinkItem[CameraImage]] = []

    def received(self, device: str, item: LinkItem[bytes] | LinkItem[CameraImage]) -> None:
        self.items.append(item)


@dataclass
class Bench:
    """Driver, emulated device and what joins them."""

    case: Case
    settings: AnyDeviceSettings
    driver: AnyDriver
    world: World
    clock: Clock
    pass_time: Callable[[float], None]
    tap: KeepingTap
    patience: float = 1.0
    """What limits of time are stretched by: more than 1 where they are real, and the machine may be busy."""
    samples: list[Sample] = field(default_factory=list)

    def forward(self, duration_s: float) -> list[Sample]:
        """Let time pass, polling and (for drives) commanding zero speeds; returns what was said."""
        said: list[Sample] = []
        end_ns = self.clock.now_ns() + nanoseconds(duration_s)
        while self.clock.now_ns() < end_ns:
            if isinstance(self.driver, WheelDrive):
                now_ns = self.clock.now_ns()
                wheels = (0.0,) * (3 if self.case.plant == "robotino" else 4)
                self.driver.command(
                    WheelCommand(t_ns=now_ns, expires_ns=now_ns + nanoseconds(0.15), speed_rad_s=wheels)
                )
            self.pass_time(STEP_S)
            said.extend(self.driver.poll())
        self.samples.extend(said)
        return said

    def forward_until(self, condition: Callable[[list[Sample]], bool], limit_s: float) -> list[Sample]:
        """Let time pass until the samples since the call meet the condition; fails at the limit."""
        said: list[Sample] = []
        deadline_ns = self.clock.now_ns() + nanoseconds(self.patience * limit_s)
        while not condition(said):
            assert self.clock.now_ns() < deadline_ns, f"not within {limit_s} s; heard {said[-5:]}"
            said.extend(self.forward(STEP_S))
        return said

    def set_plug(self, *, pulled: bool) -> None:
        """Pull or restore the plug of the emulated device."""
        for devices in (self.world.byte_devices, self.world.image_devices):
            if NAME in devices:
                devices[NAME].unplugged = pulled

    def babble(self) -> None:
        """Let the device say garbage."""
        t_ns = self.clock.now_ns()
        if isinstance(self.case.garbage, CameraImage):
            self.world.image_devices[NAME].to_host.put(t_ns, self.case.garbage)
        else:
            self.world.byte_devices[NAME].to_host.put(t_ns, self.case.garbage)


def _world(case: Case, settings: AnyDeviceSettings, start_ns: int) -> World:
    simulation = SimulationSettings.model_validate({"seed": 1, "plant": {"type": case.plant}})
    return build_world({NAME: settings}, simulation, start_ns)


@contextmanager
def lockstep(case: Case, folder: Path) -> Iterator[Bench]:
    """Driver and emulator in one process on a virtual clock."""
    clock = VirtualClock()
    settings = ADAPTER.validate_python({"type": case.device_type, **case.settings(folder)})
    world = _world(case, settings, clock.now_ns())
    tap = KeepingTap()
    driver: AnyDriver
    if isinstance(settings, FrameDeviceSettings):
        driver = settings.make_driver(NAME, LoopbackLink(world, world.image_devices[NAME], clock), clock, tap)
    else:
        driver = settings.make_driver(NAME, LoopbackLink(world, world.byte_devices[NAME], clock), clock, tap)

    def pass_time(duration_s: float) -> None:
        clock.sleep_until(clock.now_ns() + nanoseconds(duration_s))

    yield Bench(case, settings, driver, world, clock, pass_time, tap)
    driver.close()


@contextmanager
def served(case: Case, folder: Path) -> Iterator[Bench]:
    """The real link on a real port of this machine, the emulator behind it, in real time."""
    clock = SystemClock()
    settings = ADAPTER.validate_python({"type": case.device_type, **case.settings(folder)})
    world = _world(case, settings, clock.now_ns())
    tap = KeepingTap()
    driver: AnyDriver
    if isinstance(settings, FrameDeviceSettings):
        driver = settings.make_driver(NAME, settings.make_link(clock), clock, tap)
    else:
        driver = settings.make_driver(NAME, settings.make_link(clock), clock, tap)
    with Server(world, put_on_ports(world, {NAME: settings}), clock) as server:
        yield Bench(case, settings, driver, world, clock, server.run, tap, patience=20.0)
        driver.close()


BACKENDS = {"lockstep": lockstep, "served": served}
