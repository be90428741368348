"""The doctor's checks of the computer, its ports and the configuration, on made-up systems."""

import ast
import datetime as dt
import grp
import json
import os
import pwd
import re
import stat
from collections.abc import Callable, Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from drivers.can_wheels.settings import CanWheelsSettings
from drivers.clock import nanoseconds
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.config import Config
from rover_hil.doctor.configuration.config_consistency import check_consistency
from rover_hil.doctor.devices.clocks import ClockPair, check_host_clock
from rover_hil.doctor.finding import Finding, Level, SystemPaths
from rover_hil.doctor.host.can_interface import check_interface
from rover_hil.doctor.host.installation import OWNERS, check_installation
from rover_hil.doctor.host.ports import (
    CAMERA,
    SERIAL,
    Port,
    PortKind,
    check_latency_timer,
    check_port,
    no_permission,
    port_of,
)
from rover_hil.doctor.host.scheduling import check_scheduling
from rover_hil.ready.ages import check_ages

ROOT = Path(__file__).parents[2]
CAN = CanWheelsSettings(interface="socketcan", channel="can0", mapping="generic_wheel", bit_rate=500_000)
SECOND = 1_000_000_000
DAY = dt.date(2026, 11, 21)


def levels(findings: list[Finding]) -> list[Level]:
    return [finding.level for finding in findings]


# Installation


def test_a_second_owner_of_an_import_name_is_to_be_uninstalled() -> None:
    owners = {**packages_distributions(), "serial": ["pyserial", "serial"]}
    (finding,) = check_installation(owners, ())
    assert finding.level is Level.PROBLEM
    assert finding.fix.startswith("pip uninstall serial; ")


def test_a_name_that_nobody_owns_is_a_problem() -> None:
    owners = {name: [owner] for name, owner in OWNERS.items() if name != "drivers"}
    (finding,) = check_installation(owners, ())
    assert finding.subject == "import name 'drivers'"


@pytest.mark.parametrize(
    ("requirement", "what"),
    [
        ("numpy>=999", "required is 999 or newer"),
        ("no-such-library<3,>=1.0", "no-such-library is missing"),
        ("numpy>=2.1", None),
        ('no-such-library>=1.0; extra == "live"', None),
    ],
)
def test_libraries_must_reach_their_lower_bound(requirement: str, what: str | None) -> None:
    (finding,) = check_installation({name: [owner] for name, owner in OWNERS.items()}, (requirement,))
    assert (finding.level is Level.OK) == (what is None)
    assert (what or "") in finding.what


# Ports


@pytest.fixture
def system(tmp_path: Path) -> SystemPaths:
    paths = SystemPaths(tmp_path / "dev", tmp_path / "sys", tmp_path / "proc")
    for path in (paths.dev, paths.sys, paths.proc):
        path.mkdir()
    return paths


def plug_in(system: SystemPaths, name: str, link: str, target: str = "/dev/null") -> Path:
    """Make a device file that is really `target`, and its stable name."""
    device, stable = system.dev / name, system.dev / link
    device.symlink_to(target)
    stable.parent.mkdir(parents=True, exist_ok=True)
    stable.symlink_to(device)
    return device


def test_a_missing_port_is_told_with_the_names_that_are_there(system: SystemPaths) -> None:
    plug_in(system, "ttyUSB3", "serial/by-id/usb-FTDI_A7")
    (finding,) = check_port("imu", Port(SERIAL, "port", system.dev / "ttyUSB0"), system)
    assert finding.level is Level.PROBLEM
    assert finding.fix == f'in [devices.imu] set port = "{system.dev}/serial/by-id/usb-FTDI_A7"'


def test_a_dangling_link_is_an_unplugged_device(system: SystemPaths) -> None:
    link = system.dev / "imu"
    link.symlink_to("/nowhere/pts/9")
    (finding,) = check_port("imu", Port(SERIAL, "port", link), system)
    assert "/nowhere/pts/9, which does not exist" in finding.cause


def test_a_file_is_no_port(system: SystemPaths) -> None:
    (system.dev / "imu").write_text("not a device")
    (finding,) = check_port("imu", Port(SERIAL, "port", system.dev / "imu"), system)
    assert finding.what.endswith("is not a device file")


@pytest.mark.parametrize(
    ("kind", "name", "link"),
    [
        (SERIAL, "ttyACM0", "serial/by-id/usb-x"),
        (SERIAL, "ttyUSB0", "serial/by-path/pci-1"),
        (CAMERA, "video0", "v4l/by-id/cam"),
    ],
)
def test_a_moving_name_is_a_warning_with_the_stable_one(
    kind: PortKind, name: str, link: str, system: SystemPaths
) -> None:
    plug_in(system, "other", f"{Path(link).parent}/a-first-name", "/dev/zero")
    port = Port(kind, "port", plug_in(system, name, link))
    fine, moving = check_port("imu", port, system)
    assert fine.level is Level.OK
    assert moving.level is Level.WARNING
    assert moving.fix.endswith(f'= "{system.dev / link}"')
    assert levels(check_port("imu", port._replace(path=system.dev / link), system)) == [Level.OK]


def test_who_holds_the_port_is_named(system: SystemPaths) -> None:
    for pid in (4242, os.getpid()):
        (system.proc / f"{pid}/fd").mkdir(parents=True)
        (system.proc / f"{pid}/fd/3").symlink_to("/dev/null")
        (system.proc / f"{pid}/comm").write_text("gpsd\n")
    finding = check_port("imu", Port(SERIAL, "port", Path("/dev/null")), system)[-1]
    assert finding.level is Level.PROBLEM
    assert finding.cause == "it is in use by gpsd (process 4242)"
    assert "kill 4242" in finding.fix


@pytest.mark.parametrize(
    ("mode", "fix"),
    [
        (0o660, "sudo usermod -aG {group} anna"),
        (0o600, "sudo chgrp dialout /dev/ttyS9"),
        (0o620, "sudo chgrp dialout"),
    ],
)
def test_the_fix_of_a_permission_follows_the_bits(mode: int, fix: str) -> None:
    group = next(entry for entry in grp.getgrall() if entry.gr_name != "root" and "anna" not in entry.gr_mem)
    status = os.stat_result((stat.S_IFCHR | mode, 0, 0, 1, 0, group.gr_gid, 0, 0, 0, 0))
    finding = no_permission("imu", Port(SERIAL, "port", Path("/dev/ttyS9")), status, "anna")
    assert finding.level is Level.PROBLEM
    assert finding.fix.startswith(fix.format(group=group.gr_name))


@pytest.mark.skipif(os.getuid() == 0, reason="root may open everything")
def test_a_port_without_permission_is_found(system: SystemPaths) -> None:
    master, slave = os.openpty()
    path = Path(os.ttyname(slave))
    path.chmod(0)
    (finding,) = check_port("imu", Port(SERIAL, "port", path), system)
    os.close(master)
    os.close(slave)
    assert finding.what.startswith(f"user {pwd.getpwuid(os.getuid()).pw_name} may not open {path}")


@pytest.mark.parametrize(("text", "count"), [("16\n", 1), ("1\n", 0), ("?", 0)])
def test_a_slow_latency_timer_is_a_warning(text: str, count: int, system: SystemPaths) -> None:
    folder = system.sys / "bus/usb-serial/devices/ttyUSB0"
    folder.mkdir(parents=True)
    (folder / "latency_timer").write_text(text)
    findings = check_latency_timer("imu", Port(SERIAL, "port", system.dev / "ttyUSB0"), system)
    assert levels(findings) == [Level.WARNING] * count


def test_only_devices_with_a_device_file_have_a_port() -> None:
    slcan = CanWheelsSettings(interface="slcan", channel="/dev/ttyACM0", mapping="generic_wheel")
    assert port_of(slcan) == Port(SERIAL, "channel", Path("/dev/ttyACM0"))
    assert port_of(CAN) is None


# CAN interface


def make_interface(system: SystemPaths, flags: str = "0x40081", kind: str = "280") -> None:
    folder = system.sys / "class/net/can0"
    folder.mkdir(parents=True)
    (folder / "type").write_text(f"{kind}\n")
    (folder / "flags").write_text(f"{flags}\n")


def ip_details(**changes: object) -> str:
    data = {
        "state": "ERROR-ACTIVE",
        "restart_ms": 100,
        "bittiming": {"bitrate": 500_000},
        "txqlen": 100,
        **changes,
    }
    queue = data.pop("txqlen")
    return json.dumps(
        [{"ifname": "can0", "txqlen": queue, "linkinfo": {"info_kind": "can", "info_data": data}}]
    )


@pytest.mark.parametrize(
    ("changes", "level", "what", "fix"),
    [
        ({}, Level.OK, "can0 is up", ""),
        (
            {"state": "BUS-OFF"},
            Level.PROBLEM,
            "BUS-OFF",
            "sudo ip link set can0 down; sudo ip link set can0 up",
        ),
        ({"state": "ERROR-PASSIVE"}, Level.WARNING, "ERROR-PASSIVE", "60 ohm"),
        ({"bittiming": {"bitrate": 250_000}}, Level.PROBLEM, "250000", "bitrate 500000 restart-ms 100"),
        (
            {"ctrlmode": ["LISTEN-ONLY", "BERR-REPORTING"]},
            Level.PROBLEM,
            "can0 is in mode LISTEN-ONLY: nothing that is sent reaches the bus",
            "restart-ms 100 loopback off listen-only off",
        ),
        ({"restart_ms": 0}, Level.WARNING, "stays off", "restart-ms 100"),
        ({"txqlen": 10}, Level.WARNING, "10 frames", "txqueuelen 100"),
    ],
)
def test_the_state_of_a_can_interface(
    changes: dict[str, object], level: Level, what: str, fix: str, system: SystemPaths
) -> None:
    make_interface(system)
    (finding,) = check_interface("wheels", CAN, system.sys, ip_details(**changes))
    assert finding.level is level
    assert what in finding.what
    assert fix in finding.fix


def test_a_can_interface_that_is_down_missing_or_none(system: SystemPaths) -> None:
    (missing,) = check_interface("wheels", CAN, system.sys, "")
    assert missing.what == "there is no network interface can0"
    make_interface(system, flags="0x40080")
    (down,) = check_interface("wheels", CAN, system.sys, "")
    assert down.fix == "sudo ip link set can0 up type can bitrate 500000 restart-ms 100"
    virtual = json.dumps([{"ifname": "can0", "linkinfo": {"info_kind": "vcan"}}])
    (down,) = check_interface("wheels", CAN, system.sys, virtual)
    assert down.fix == "sudo ip link set can0 up"
    (other,) = check_interface("wheels", CAN.model_copy(update={"channel": "can1"}), system.sys, "")
    assert other.fix.endswith("set channel to one of: can0")
    (system.sys / "class/net/can0/type").write_text("1")
    (ethernet,) = check_interface("wheels", CAN, system.sys, "")
    assert ethernet.what == "can0 is not a CAN interface"


@pytest.mark.parametrize("text", ["", "no json", "[]", "[3]", '[{"linkinfo": 3}]'])
def test_without_the_ip_tool_the_rest_is_still_looked_at(text: str, system: SystemPaths) -> None:
    make_interface(system)
    assert levels(check_interface("wheels", CAN, system.sys, text)) == [Level.OK]


# Clocks, scheduling, calibration, configuration


@pytest.mark.parametrize(
    ("wall_s", "step_s", "level"),
    [(1.795e9, 0.0, Level.OK), (1.795e9, -0.5, Level.WARNING), (1.0e6, 0.0, Level.WARNING)],
)
def test_host_clock(wall_s: float, step_s: float, level: Level) -> None:
    before = ClockPair(nanoseconds(wall_s), 5 * SECOND)
    after = ClockPair(nanoseconds(wall_s + 2.0 + step_s), 7 * SECOND)
    assert levels(check_host_clock(before, after)) == [level]


@pytest.mark.parametrize(
    ("governor", "allowed", "expected"),
    [
        ("performance", True, [Level.OK]),
        ("powersave", True, [Level.WARNING]),
        ("powersave", False, [Level.WARNING, Level.WARNING]),
    ],
)
def test_scheduling(governor: str, allowed: bool, expected: list[Level], system: SystemPaths) -> None:
    folder = system.sys / "devices/system/cpu/cpu0/cpufreq"
    folder.mkdir(parents=True)
    (folder / "scaling_governor").write_text(f"{governor}\n")
    assert levels(check_scheduling(system, realtime_allowed=allowed)) == expected


@pytest.fixture
def configure() -> Callable[..., Config]:
    def make(
        rate_hz: float = 50.0, expiry_s: float = 0.15, max_age_s: float = 0.15, calibration: str | None = None
    ) -> Config:
        return Config.model_validate(
            {
                "schema": "rover-hil-config/1",
                "rover": {"kinematics": "omni3", "wheel_radius_m": 0.04, "base_radius_m": 0.125},
                "limits": {"wheel_speed_rad_s": 4, "wheel_acceleration_rad_s2": 4},
                "loop": {"rate_hz": rate_hz},
                "safety": {"expiry_s": expiry_s},
                "roles": {"wheels": "board", "headings": ["compass"]},
                "devices": {
                    "board": RobotinoBoardSettings(type="robotino_board", port="/dev/x", max_age_s=max_age_s),
                    "compass": NmeaCompassSettings(port="/dev/y", calibration=calibration),
                    "imu": WitMotionSettings(port="/dev/z"),
                },
            }
        )

    return make


def test_calibration_is_recent_old_from_the_future_or_missing(
    configure: Callable[..., Config], tmp_path: Path
) -> None:
    table = tmp_path / "deviation.toml"
    for date, level in (
        ("2026-11-01", Level.OK),
        ("2025-06-01", Level.WARNING),
        ("2027-01-01", Level.WARNING),
    ):
        table.write_text(
            f'source = "swung"\ndate = {date}\n'
            "heading_deg = [0, 90, 180, 270]\ndeviation_deg = [1, 2, 1, 0]\n"
        )
        assert levels(check_ages(configure(calibration=str(table)), DAY)) == [level]
    (finding,) = check_ages(configure(), DAY)
    assert (finding.subject, finding.level) == ("compass", Level.WARNING)


@pytest.mark.parametrize(
    ("rate_hz", "expiry_s", "max_age_s", "expected"),
    [
        (50, 0.15, 0.15, [Level.OK]),
        (10, 0.15, 0.5, [Level.WARNING]),
        (5, 0.15, 0.5, [Level.PROBLEM]),
        (50, 0.15, 0.03, [Level.PROBLEM]),
    ],
)
def test_times_that_do_not_fit(
    rate_hz: float, expiry_s: float, max_age_s: float, expected: list[Level], configure: Callable[..., Config]
) -> None:
    assert levels(check_consistency(configure(rate_hz, expiry_s, max_age_s))) == expected


# The page


def source_texts() -> Iterator[str]:
    """Yield every text in the program, with `…` for what it fills in."""
    for package in ("drivers", "controllers", "sim_backends", "rover_hil"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    yield "".join(
                        str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values
                    )
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield node.value


def test_the_page_words_messages_as_the_program_does() -> None:
    page = (ROOT / "docs/how-to/troubleshooting.md").read_text("utf-8")
    cells = [line.split("|")[1] for line in page.splitlines() if line.startswith("| ")]
    messages = [
        message for cell in cells for message in re.findall(r"`([^`]+)`", cell) if message != "brltty"
    ]
    texts = list(source_texts())
    patterns = {message: ".*".join(map(re.escape, message.split("…"))) for message in messages}
    unknown = [m for m, pattern in patterns.items() if not any(re.search(pattern, text) for text in texts)]
    assert len(messages) > 50
    assert unknown == []
