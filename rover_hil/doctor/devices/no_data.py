"""Explain why a device delivers no data."""

import re

from drivers.canopen_wheels.settings import CanopenWheelsSettings
from drivers.device_settings import CanDeviceSettings, SerialDeviceSettings
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.nmea_gnss.settings import NmeaGnssSettings
from drivers.robotino3_board.settings import Robotino3BoardSettings
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.vectornav.settings import VectorNavSettings
from drivers.vesc.settings import VescSettings
from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.devices.rejections import advice_for, list_reasons
from rover_hil.doctor.finding import Finding, problem, warning

CHECK = "data"
GARBLED = frozenset({"framing", "checksum"})

_MESSAGE_NAME = re.compile(rb"(?<![^\r\n])[$#!%]([A-Z][A-Z0-9]{2,15}),")
"""Name at the start of a line: NMEA 0183, AIS, and logs of VectorNav, Unicore and NovAtel devices."""


def check_no_data(reception: Reception) -> list[Finding]:
    """Explain why no sample arrived; no finding when one did."""
    if reception.health.accepted:
        return []
    if not reception.arrivals and not reception.health.rejected:
        return [_nothing_arrives(reception)]
    if isinstance(reception.settings, CanopenWheelsSettings) and not reception.health.rejected:
        return [_only_heartbeats(reception)]
    reasons = list_reasons(reception)
    byte_count = sum(len(arrival.payload) for arrival in reception.arrivals)
    what = f"no usable data arrives; rejected: {reasons}" if reasons else f"{byte_count} undecodable bytes"
    cause, fix = _explain_rejection(reception)
    return [problem(CHECK, reception.device, what + _message_names(reception), cause, fix)]


def _only_heartbeats(reception: Reception) -> Finding:
    return warning(
        CHECK,
        reception.device,
        "heartbeats arrive, but no measurements",
        "the drives are not configured yet, which is normal: the doctor does not change them",
        "no fix needed if the next run drives",
    )


def _nothing_arrives(reception: Reception) -> Finding:
    settings, name = reception.settings, reception.device
    if isinstance(settings, RobotinoBoardSettings):
        cause = "the board does not answer: it is off, or it is not on this port"
        fix = f"switch the rover on; in [devices.{name}] check port and baud_rate = {settings.baud_rate}"
    elif isinstance(settings, Robotino3BoardSettings):
        cause = "the board does not answer: it is off, or the daemon of the Robotino uses it"
        fix = (
            "switch the rover on; stop the daemon (`sudo systemctl stop controld3`); "
            f"check port in [devices.{name}]"
        )
    elif isinstance(settings, SerialDeviceSettings):
        cause = "the device is off, its transmit line is not connected, or it only answers requests"
        fix = f"check its power and that its TX goes to our RX; check with `xxd {settings.port} | head`"
    elif isinstance(settings, VescSettings):
        cause = "the controllers are off, send no status messages, or the bit rate is wrong"
        fix = (
            "in VESC Tool, App Settings, General, enable CAN Status Messages 1 and 5 at 50 Hz; "
            f"in [devices.{name}] check channel and bit_rate = {settings.bit_rate}"
        )
    elif isinstance(settings, CanDeviceSettings):
        cause = "the drives are off, the bus is not connected, or its bit rate is wrong"
        fix = f"switch the drives on; in [devices.{name}] check channel and bit_rate = {settings.bit_rate}"
    else:
        cause = "the source delivers no frames"
        fix = f"check the cable, or start what fills the folder; in [devices.{name}] check path"
    return problem(CHECK, name, "nothing arrives", cause, fix)


def _explain_rejection(reception: Reception) -> tuple[str, str]:
    settings, name, rejected = reception.settings, reception.device, reception.health.rejected
    if isinstance(settings, NmeaCompassSettings) and set(rejected) == {"checksum"}:
        return (
            "the sentences carry no checksum, or a wrong one",
            f"if they end without *hh, in [devices.{name}] set require_checksum = false",
        )
    reason = max(rejected, key=lambda reason: rejected[reason], default="framing")
    if isinstance(settings, SerialDeviceSettings) and reason in GARBLED:
        return (
            "the baud rate is wrong, or another kind of device is on this port",
            f"in [devices.{name}] set baud_rate to the device's own, e.g. 4800, 9600, 38400 or 115200 "
            f"(now {settings.baud_rate}), or set port to the right one",
        )
    advice = advice_for(reason, settings.type)
    return advice.cause, advice.fix.format(device=name)


def _message_names(reception: Reception) -> str:
    """Return which messages a device that sends text has sent, to show that they are the wrong ones."""
    if not isinstance(reception.settings, NmeaCompassSettings | NmeaGnssSettings | VectorNavSettings):
        return ""
    data = b"".join(arrival.payload for arrival in reception.arrivals)
    names = sorted({name.decode() for name in _MESSAGE_NAME.findall(data)})
    return f"; it sends {', '.join(names)}" if names else ""
