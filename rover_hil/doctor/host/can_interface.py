"""Check SocketCAN network interfaces: present, up, at the configured bit rate, without errors."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import TypeGuard

from drivers.device_settings import CanDeviceSettings
from rover_hil.doctor.finding import CAN_WIRING, Finding, ok, problem, read_text, warning

CHECK = "CAN interface"
CAN_LINK_TYPE = "280"
"""ARPHRD_CAN of linux/if_arp.h."""
UP_FLAG = 0x1
"""IFF_UP of linux/if.h."""
SHORTEST_QUEUE = 100
SILENT_MODES = ("LISTEN-ONLY", "LOOPBACK")
RESTART_MS = 100
IP_TIMEOUT_S = 2.0


def read_ip_details(channel: str) -> str:
    """Return what `ip -details -json link show` prints about an interface; "" where it cannot run."""
    program = shutil.which("ip")
    if program is None:
        return ""
    command = [program, "-details", "-json", "link", "show", "dev", channel]
    try:
        # The program is the system's own, and the name is one argument that no shell interprets.
        run = subprocess.run(  # noqa: S603
            command, capture_output=True, text=True, check=False, timeout=IP_TIMEOUT_S
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return run.stdout


def check_interface(device: str, settings: CanDeviceSettings, sys: Path, ip_details: str) -> list[Finding]:
    """Check the network interface of a CAN bus.

    Args:
        device: Name of the device.
        settings: Its settings; the interface must be "socketcan".
        sys: The system's /sys.
        ip_details: What `read_ip_details` returned.
    """
    channel = settings.channel
    folder = sys / "class/net" / channel
    if not folder.is_dir():
        return [_no_interface(device, sys, f"there is no network interface {channel}")]
    if read_text(folder / "type") != CAN_LINK_TYPE:
        return [_no_interface(device, sys, f"{channel} is not a CAN interface")]
    details = _details_of(ip_details)
    data = _table(_table(details.get("linkinfo")).get("info_data"))
    if not int(read_text(folder / "flags") or "0", 16) & UP_FLAG:
        return [
            problem(
                CHECK,
                device,
                f"{channel} is down",
                "the interface has not been switched on since it was plugged in",
                _switch_on(settings, details),
            )
        ]
    findings = [
        *_check_state(device, settings, data),
        *_check_mode(device, settings, data),
        *_check_bit_rate(device, settings, data),
        *_check_restart(device, settings, data),
        *_check_queue(device, channel, details),
    ]
    return findings or [ok(CHECK, device, f"{channel} is up")]


def _no_interface(device: str, sys: Path, what: str) -> Finding:
    others = _can_interfaces(sys)
    if others:
        cause = f"the interface has another name: the CAN interfaces are {others}"
        fix = f"in [devices.{device}] set channel to one of: {others}"
    else:
        cause = "the adapter is not plugged in, or its kernel driver is not loaded"
        fix = "plug it in and check with `ip -brief link show type can` and `sudo dmesg | tail`"
    return problem(CHECK, device, what, cause, fix)


def _can_interfaces(sys: Path) -> str:
    folders = sorted((sys / "class/net").glob("*"))
    return ", ".join(folder.name for folder in folders if read_text(folder / "type") == CAN_LINK_TYPE)


def _check_state(device: str, settings: CanDeviceSettings, data: dict[str, object]) -> list[Finding]:
    state, channel = data.get("state"), settings.channel
    if state == "BUS-OFF":
        return [
            problem(
                CHECK,
                device,
                f"{channel} is in state BUS-OFF: it has left the bus",
                "too many errors: wrong bit rate, missing termination, or a short circuit between the wires",
                f"sudo ip link set {channel} down; {_bring_up(settings)}",
            )
        ]
    if state in ("ERROR-PASSIVE", "ERROR-WARNING"):
        return [
            warning(
                CHECK,
                device,
                f"{channel} is in state {state}",
                "many errors: wrong bit rate, missing termination, or no other node on the bus",
                CAN_WIRING,
            )
        ]
    return []


def _check_mode(device: str, settings: CanDeviceSettings, data: dict[str, object]) -> list[Finding]:
    modes = data.get("ctrlmode")
    silent = [mode for mode in SILENT_MODES if isinstance(modes, list) and mode in modes]
    if not silent:
        return []
    channel = settings.channel
    return [
        problem(
            CHECK,
            device,
            f"{channel} is in mode {' and '.join(silent)}: nothing that is sent reaches the bus",
            "the mode was set when the interface was brought up",
            f"sudo ip link set {channel} down; {_bring_up(settings)} loopback off listen-only off",
        )
    ]


def _check_bit_rate(device: str, settings: CanDeviceSettings, data: dict[str, object]) -> list[Finding]:
    bit_rate = _table(data.get("bittiming")).get("bitrate")
    if not _is_number(bit_rate) or bit_rate == settings.bit_rate:
        return []
    channel = settings.channel
    return [
        problem(
            CHECK,
            device,
            f"{channel} runs at {bit_rate} bit/s, configured are {settings.bit_rate}",
            "the interface keeps the bit rate that it was brought up with",
            f"sudo ip link set {channel} down; {_bring_up(settings)}  "
            f"(or in [devices.{device}] set bit_rate = {bit_rate})",
        )
    ]


def _check_restart(device: str, settings: CanDeviceSettings, data: dict[str, object]) -> list[Finding]:
    if data.get("restart_ms") != 0:
        return []
    channel = settings.channel
    return [
        warning(
            CHECK,
            device,
            f"{channel} stays off the bus after a bus-off",
            "restart-ms is 0: the kernel does not restart the controller by itself",
            f"sudo ip link set {channel} down; {_bring_up(settings)}",
        )
    ]


def _check_queue(device: str, channel: str, details: dict[str, object]) -> list[Finding]:
    length = details.get("txqlen")
    if not _is_number(length) or length >= SHORTEST_QUEUE:
        return []
    return [
        warning(
            CHECK,
            device,
            f"the send queue of {channel} holds only {length} frames",
            "when the bus is busy, setpoints beyond that are dropped",
            f"sudo ip link set {channel} txqueuelen {SHORTEST_QUEUE}",
        )
    ]


def _switch_on(settings: CanDeviceSettings, details: dict[str, object]) -> str:
    """Return the command that brings an interface up; a virtual one has no bit rate."""
    if _table(details.get("linkinfo")).get("info_kind") in ("vcan", "vxcan"):
        return f"sudo ip link set {settings.channel} up"
    return _bring_up(settings)


def _bring_up(settings: CanDeviceSettings) -> str:
    return (
        f"sudo ip link set {settings.channel} up type can bitrate {settings.bit_rate} restart-ms {RESTART_MS}"
    )


def _details_of(ip_details: str) -> dict[str, object]:
    try:
        links = json.loads(ip_details)
    except ValueError:
        return {}
    return _table(links[0]) if isinstance(links, list) and links else {}


def _table(value: object) -> dict[str, object]:
    return value if isinstance(value, dict) else {}


def _is_number(value: object) -> TypeGuard[int]:
    return isinstance(value, int)
