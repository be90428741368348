"""A world served in real time and driven through the drivers of the real devices."""

from pathlib import Path

import pytest
from pydantic import TypeAdapter

from drivers.clock import SystemClock, VirtualClock, nanoseconds, seconds
from drivers.errors import ConfigError, NotConnectedError
from drivers.registry import AnyDeviceSettings
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import LinkSample, RateSample, WheelCommand, WheelSample
from drivers.witmotion.settings import WitMotionSettings
from sim_backends.build import build_world
from sim_backends.serving.can_bus_port import CanBusPort
from sim_backends.serving.frame_port import FramePort
from sim_backends.serving.port import Port
from sim_backends.serving.server import ServedDevice, Server, put_on_ports
from sim_backends.serving.slcan_port import SlcanPort
from sim_backends.settings import SimulationSettings
from sim_backends.world.line import Line
from sim_backends.world.world import EmulatedDevice, World
from tests.sim_backends.turning_plant import TurningPlant

DEADLINE_S = 60.0


class ServingClock(SystemClock):
    """The host's clock; whoever sleeps on it lets the server run."""

    def __init__(self, server: Server) -> None:
        super().__init__()
        self._server = server

    def sleep_until(self, deadline_ns: int) -> None:
        self._server.run(max(0.001, seconds(deadline_ns - self.now_ns())))


def robotino(folder: Path, *faults: dict[str, object]) -> tuple[Server, dict[str, AnyDeviceSettings]]:
    devices: dict[str, AnyDeviceSettings] = {
        "board": RobotinoBoardSettings(type="robotino_board", port=str(folder / "ports" / "board")),
        "imu": WitMotionSettings(type="witmotion", port=str(folder / "ports" / "imu")),
    }
    simulation = SimulationSettings.model_validate({"plant": {"type": "robotino"}, "faults": faults})
    clock = SystemClock()
    world = build_world(devices, simulation, clock.now_ns())
    return Server(world, put_on_ports(world, devices), clock), devices


def test_a_rover_drives_over_pseudo_terminals_in_real_time(tmp_path: Path) -> None:
    server, devices = robotino(tmp_path)
    board_settings, imu_settings = devices["board"], devices["imu"]
    assert isinstance(board_settings, RobotinoBoardSettings)
    assert isinstance(imu_settings, WitMotionSettings)
    clock = ServingClock(server)
    with (
        server,
        board_settings.make_driver("board", board_settings.make_link(clock), clock) as board,
        imu_settings.make_driver("imu", imu_settings.make_link(clock), clock) as imu,
    ):
        end_ns = clock.now_ns() + nanoseconds(DEADLINE_S)
        while server.world.plant.truth().x_m < 0.02 and clock.now_ns() < end_ns:
            now_ns = clock.now_ns()
            board.command(
                WheelCommand(t_ns=now_ns, expires_ns=now_ns + nanoseconds(0.15), speed_rad_s=(-8.0, 0.0, 8.0))
            )
            wheel = board.wait_next(WheelSample, 1.0)
            assert abs(wheel.t_ns - clock.now_ns()) < nanoseconds(1.0)
            board.poll()
        assert server.world.plant.truth().x_m >= 0.02
        imu.wait_next(RateSample, 1.0)
        assert all(device.sent > 0 and device.dropped == 0 for device in server.served)
    assert list(tmp_path.iterdir()) == []


def test_a_replug_comes_back_on_the_same_path(tmp_path: Path) -> None:
    fault = {"type": "unplug", "device": "imu", "start_s": 0.3, "duration_s": 0.3}
    server, devices = robotino(tmp_path, fault)
    imu_settings = devices["imu"]
    assert isinstance(imu_settings, WitMotionSettings)
    clock = ServingClock(server)
    with server, imu_settings.make_driver("imu", imu_settings.make_link(clock), clock) as imu:
        imu.wait_next(RateSample, 1.0)
        assert not imu.wait_next(LinkSample, DEADLINE_S).up
        assert not Path(imu_settings.port).is_symlink()
        assert imu.wait_next(LinkSample, DEADLINE_S).up
        imu.wait_next(RateSample, 1.0)


def test_ports_that_cannot_all_be_made_are_all_removed(tmp_path: Path) -> None:
    (tmp_path / "ports").mkdir()
    (tmp_path / "ports" / "imu").write_text("precious")
    server, _ = robotino(tmp_path)
    with pytest.raises(NotConnectedError, match="imu"):
        server.__enter__()
    assert [path.name for path in (tmp_path / "ports").iterdir()] == ["imu"]


class SlowPort(Port[bytes]):
    """Takes its time to read, and at most two payloads."""

    where = "nowhere"

    def __init__(self, clock: VirtualClock) -> None:
        self.room = 2
        self.has_host = False
        self._clock = clock

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def read(self) -> list[bytes]:
        self._clock.sleep_until(self._clock.now_ns() + 2_500_000)
        return []

    def has_listener(self) -> bool:
        return self.has_host

    def write(self, payload: bytes) -> bool:
        self.room -= 1
        return self.room >= 0


class Quiet:
    next_event_ns = 2**63 - 1

    def act(self, t_ns: int) -> None:
        pass

    def receive(self, t_ns: int, payload: bytes) -> None:
        pass


def test_late_cycles_are_skipped_and_losses_counted() -> None:
    clock = VirtualClock()
    line: Line[bytes] = Line(lambda payload: 1.0, 1e9)
    device = EmulatedDevice("x", Quiet(), line, Line(lambda payload: 1.0, 1e9))
    port = SlowPort(clock)
    served = ServedDevice(device, port)
    with Server(World(TurningPlant(), {"x": device}), [served], clock) as server:
        for has_host in (False, True):
            port.has_host = has_host
            for _ in range(5):
                line.put(clock.now_ns(), b"x")
            server.run(0.030)
    assert (served.sent, served.dropped) == (2, 3)
    assert server.skipped_cycles == 40  # of 60: each cycle takes three


CAMERA = {"type": "camera", "path": "ports/camera", "width": 160, "height": 120, "frame_rate_hz": 5}
CAN = {"type": "can_wheels", "channel": "ports/can", "mapping": "generic_wheel"}


@pytest.mark.parametrize(
    ("device", "kind", "where"),
    [
        ({**CAMERA, "source": "live_folder"}, FramePort, "ports/camera"),
        ({**CAN, "interface": "slcan"}, SlcanPort, "ports/can (slcan)"),
        ({**CAN, "interface": "socketcan"}, CanBusPort, "ports/can (socketcan)"),
    ],
)
def test_every_device_gets_the_port_its_settings_name(
    device: dict[str, object], kind: type[Port[bytes]], where: str
) -> None:
    (served,) = put_on_ports(*one_device(device))
    assert isinstance(served.port, kind)
    assert served.port.where == where


@pytest.mark.parametrize(
    ("device", "message"),
    [
        ({**CAMERA, "source": "v4l2"}, r"devices.x.source: .* 'live_folder'"),
        ({**CAN, "interface": "virtual"}, r"devices.x.interface: .* use slcan or socketcan"),
    ],
)
def test_ports_that_no_other_process_reaches_are_refused(device: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        put_on_ports(*one_device(device))


def one_device(device: dict[str, object]) -> tuple[World, dict[str, AnyDeviceSettings]]:
    adapter: TypeAdapter[AnyDeviceSettings] = TypeAdapter(AnyDeviceSettings)
    devices = {"x": adapter.validate_python(device)}
    simulation = SimulationSettings.model_validate({"plant": {"type": "el_dorado"}})
    return build_world(devices, simulation, 1), devices
