"""Explain why data was rejected."""

from typing import NamedTuple

from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.finding import CAN_WIRING, Finding, Level

CHECK = "rejected data"

TOLERATED = 2
"""Listening begins and ends within a frame, so one or two are cut."""
TOLERATED_SHARE = 0.01


class Advice(NamedTuple):
    """Cause and fix of one reason; `{device}` is replaced by the name of the device.

    Attributes:
        level: Severity when good data arrives too; OK for valid data that is not for us.
    """

    level: Level
    cause: str
    fix: str


_NOISE = Advice(
    Level.WARNING,
    "bytes are damaged or lost on the way: a long or loose cable, motor noise, a baud rate slightly off",
    "shorten or replace the cable, keep it away from the motors, compare baud_rate in [devices.{device}]",
)
_OLD_DATA = Advice(
    Level.WARNING,
    "the device repeats old messages, or two nodes send under one identifier",
    "make sure that every drive has its own node number, and update the drive's firmware",
)
_OTHER_LAYOUT = Advice(
    Level.PROBLEM,
    "the layout of the messages differs from the DBC file",
    "take the DBC file of your drive's firmware version and name it in the mapping of [devices.{device}]",
)
_OTHER_BOARD = Advice(
    Level.PROBLEM,
    "the built-in Robotino board is not the configured one; its currents would be misread",
    'in [devices.{device}] set board to the other of "EA05" and "EA09"',
)
_OTHER_IMAGES = Advice(
    Level.PROBLEM,
    "size or depth of the images is not the configured one",
    "in [devices.{device}] set width and height to those of the images",
)
_CONTRADICTION = Advice(
    Level.PROBLEM,
    "the speed that a drive reports cannot have turned its wheel as the positions say: one of them is wrong",
    "compare units, gear and counts per turn in [devices.{device}] with the drive; update its firmware",
)
_STANDING_CAMERA = Advice(
    Level.WARNING,
    "the camera, or the program that fills the folder, delivers the same frame again",
    "connect the camera without a hub, or lower frame_rate_hz in [devices.{device}]",
)

_COMPASS_OUTPUT = (
    "set it to send HDG, HDM, HDT or THS; a GNSS receiver with two antennas has THS (Unicore UM982: send "
    "GPTHS 0.1, and SAVECONFIG to keep it), one with a single antenna has no heading, only a course"
)
_ADVICE = {
    "other_sentence": Advice(
        Level.OK,
        "the device sends sentences, but none with heading, rate or attitude in a form that is read",
        _COMPASS_OUTPUT,
    ),
    "other_type": Advice(
        Level.OK,
        "the device sends frames, but none with acceleration, rate or angle",
        "enable the outputs 0x51, 0x52 and 0x53 with the manufacturer's program",
    ),
    "no_magnetic_field": Advice(
        Level.PROBLEM,
        "the sensor sends 0x61 frames (Bluetooth models), without the magnetic field of the calibration",
        "remove calibration from [devices.{device}] to use the sensor's own yaw",
    ),
    "other_traffic": Advice(
        Level.OK,
        "frames arrive, but none that the mapping contains",
        "in [devices.{device}] set mapping to that of your drives, and in it the node number of each wheel",
    ),
    "framing": _NOISE,
    "checksum": _NOISE,
    "format": Advice(
        Level.WARNING,
        "the device writes sentences that differ from NMEA 0183",
        "update its firmware, or set it to send HDG, HDM, HDT or THS",
    ),
    "empty": Advice(
        Level.WARNING,
        "the device has no heading yet, or an image was damaged",
        "wait until the device has settled (a GNSS compass needs the sky); for images check cable and files",
    ),
    "invalid_mode": Advice(
        Level.WARNING,
        "the device itself marks its values as estimated, simulated or void",
        "wait until it has settled (a GNSS compass needs the sky)",
    ),
    "stale": Advice(
        Level.WARNING,
        "the receiver sends one position again and again, or the same in several sentences",
        "wait until it has the sky; if that stays, let it send GGA once per position",
    ),
    "no_fix": Advice(
        Level.WARNING,
        "the receiver has no position",
        "wait until its antenna has seen the open sky for some minutes; check antenna and cable",
    ),
    "uncertain": Advice(
        Level.WARNING,
        "the receiver knows its position to worse than 100 m only",
        "wait until its antenna has seen the open sky for some minutes; check antenna and cable",
    ),
    "range": _NOISE,
    "no_attitude": Advice(
        Level.WARNING,
        "the magnetic field came without roll and pitch, which the heading needs",
        "enable the angle output (0x53) of the sensor with the manufacturer's program",
    ),
    "board_is_EA05": _OTHER_BOARD,
    "board_is_EA09": _OTHER_BOARD,
    "motor_fault": Advice(
        Level.PROBLEM,
        "the board cannot read one of its motors",
        "switch the rover off and on; if the fault remains, check the plugs of motors and encoders",
    ),
    "implausible_jump": Advice(
        Level.WARNING,
        "encoder counts jumped further than a wheel can turn: damaged replies, or the board has restarted",
        "charge the battery, check the cable to the board",
    ),
    "not_a_frame": Advice(
        Level.WARNING,
        "an slcan adapter sends garbled lines (frames of CAN FD never reach this program)",
        "replace the adapter's cable; connect it without a hub",
    ),
    "too_short": _OTHER_LAYOUT,
    "not_finite": _OTHER_LAYOUT,
    "out_of_range": _OTHER_LAYOUT,
    "speed_contradicts_position": _CONTRADICTION,
    "negative_as_unsigned": Advice(
        Level.PROBLEM,
        "a drive sends negative values in a signal that the DBC file calls unsigned: they would be read as "
        "the largest ones, such as 6553.5 A",
        "in the DBC file of [devices.{device}] write - instead of + behind the bits "
        "of currents and speeds, as in `48|16@1-`",
    ),
    "position_ambiguous": Advice(
        Level.PROBLEM,
        "a wheel moves by more than a quarter of the range of its position between two messages, or its "
        "drive counts other turns: whole turns may be lost",
        "send the messages more often; if the drive counts turns, name that signal as `turns` of position in "
        "the mapping of [devices.{device}]",
    ),
    "counter_repeat": _OLD_DATA,
    "counter_backwards": _OLD_DATA,
    "frames_lost": Advice(
        Level.WARNING,
        "the receiver was too slow, or the bus is overloaded",
        "sudo sysctl -w net.core.rmem_default=1000000; lower the sending rates of the drives",
    ),
    "bus_lost_arbitration": Advice(
        Level.WARNING,
        "the bus is busy with messages of higher priority",
        "lower the sending rates of the drives",
    ),
    "bus_warning": Advice(
        Level.WARNING,
        "the CAN controller counts errors",
        CAN_WIRING,
    ),
    "size": _OTHER_IMAGES,
    "dtype": _OTHER_IMAGES,
    "stamp_not_moving": _STANDING_CAMERA,
    "stamp_backwards": _STANDING_CAMERA,
    "stamp_old": Advice(
        Level.WARNING,
        "frames arrive a second after they were taken",
        "lower frame_rate_hz, or end the programs that use the processor",
    ),
    "stamp_future": Advice(
        Level.PROBLEM,
        "frames carry times later than this computer's clock: a camera or program with another clock",
        "let what fills the folder stamp with the monotonic clock of this computer (names in nanoseconds)",
    ),
    "black": Advice(
        Level.WARNING,
        "the camera sends black frames",
        "uncover the lens, or raise exposure_100us",
    ),
}
_XSENS_OUTPUT = "set the output with MT Manager: rate of turn, acceleration, quaternion, as float, frame ENU"
_VECTORNAV_OUTPUT = "set the asynchronous output to YMR: send $VNWRG,06,14*59, and $VNWNV*57 to keep it"
_ADVICE_OF_TYPE = {
    "can_wheels": {
        "implausible_jump": Advice(
            Level.PROBLEM,
            "a position jumped further than a wheel can turn: the drive has restarted, or its counter begins "
            "anew elsewhere than the mapping says",
            "check the supply of the drives; in the mapping of [devices.{device}] set wrap of position to "
            "where the counter begins anew, e.g. 4096",
        ),
    },
    "canopen_wheels": {
        "other_traffic": Advice(
            Level.OK,
            "frames arrive, but no CANopen messages of the drives",
            "switch the drives on; in [devices.{device}] set node of each wheel to that of its drive",
        ),
        "other_node": Advice(
            Level.WARNING,
            "a CANopen node sends that no wheel has",
            "set node of each wheel in [devices.{device}] to that of its drive",
        ),
        "too_short": Advice(
            Level.PROBLEM,
            "PDOs are shorter than configured: another CANopen master maps them otherwise",
            "end the other master; switch the drives off and on",
        ),
        "implausible_jump": Advice(
            Level.WARNING,
            "a position jumped further than the motor can turn: the drive has restarted, or was homed",
            "check the supply of the drives for dips, and rpm_limit in [devices.{device}]",
        ),
    },
    "robotino3_board": {
        "layout": Advice(
            Level.PROBLEM,
            "the messages of the board have other sizes than those of Robotino 3 and 4",
            'for a Robotino 1, 2 or XT set type = "robotino_board" in [devices.{device}]',
        ),
        "board_warning": Advice(
            Level.WARNING,
            "the board sends a warning",
            "charge the battery; switch the rover off and on",
        ),
        "board_error": Advice(
            Level.PROBLEM,
            "the board reports an error in what it received or measured",
            "end other programs that use the board (`sudo systemctl stop controld3`); "
            "switch the rover off and on",
        ),
    },
    "xsens": {
        "other_message": Advice(
            Level.OK,
            "the sensor sends messages, but no measurements: it may be in its configuration state",
            "switch it off and on; if nothing comes, " + _XSENS_OUTPUT,
        ),
        "legacy_output": Advice(
            Level.PROBLEM, "the sensor sends MTData messages of an old output mode", _XSENS_OUTPUT
        ),
        "layout": Advice(
            Level.WARNING, "the items of a message do not have the sizes of the manual", _XSENS_OUTPUT
        ),
        "number_format": Advice(
            Level.PROBLEM, "the sensor sends fixed-point numbers of 48 bits", _XSENS_OUTPUT
        ),
        "ned_frame": Advice(
            Level.PROBLEM, "the sensor sends its orientation in the north-east-down frame", _XSENS_OUTPUT
        ),
        "clipped": Advice(
            Level.WARNING,
            "the sensor is shaken beyond its range, so its values are wrong",
            "mount it on something soft, away from motors and edges of the frame",
        ),
        "filter_invalid": Advice(
            Level.WARNING,
            "the sensor does not trust its own orientation",
            "let it rest for some seconds after it is switched on; keep iron and magnets away from it",
        ),
        "messages_lost": Advice(
            Level.WARNING,
            "messages were lost: the line is too slow for the output, or this computer is too busy",
            "raise baud_rate in [devices.{device}] and in the sensor, or lower its output rate",
        ),
        "device_error": Advice(
            Level.PROBLEM,
            "the sensor reports an error, e.g. that its output does not fit through the line",
            "raise baud_rate in [devices.{device}] and in the sensor, or lower its output rate",
        ),
    },
    "vesc": {
        "other_traffic": Advice(
            Level.OK,
            "frames arrive, but no status messages of a VESC",
            'set the CAN mode of the controllers to "VESC" (VESC Tool, App Settings, General)',
        ),
        "other_node": Advice(
            Level.PROBLEM,
            "a VESC sends whose ID no wheel has",
            "set node of each wheel in [devices.{device}] to the VESC ID of its controller",
        ),
        "too_short": Advice(
            Level.PROBLEM,
            "status messages are shorter than those of a VESC: other devices use the same identifiers",
            "give the other devices other identifiers, or a bus of their own",
        ),
        "implausible_jump": Advice(
            Level.WARNING,
            "the tachometer jumped further than the motor can turn: the controller has restarted",
            "check the supply of the controllers for dips, and erpm_limit in [devices.{device}]",
        ),
        "no_fault_report": Advice(
            Level.WARNING,
            "a controller does not answer when asked for its fault, so faults do not show",
            "update its firmware (5.02 or later), "
            "and choose a host_id in [devices.{device}] that no other node on the bus has",
        ),
    },
    "vectornav": {
        "other_message": Advice(
            Level.OK,
            "the device sends messages, but none with rates, angles or accelerations in a form that is read",
            _VECTORNAV_OUTPUT,
        ),
        "not_tracking": Advice(
            Level.WARNING,
            "the navigation filter of the sensor has not settled: the yaw of its INS messages is not valid",
            "give its antennas the sky and drive it around, or " + _VECTORNAV_OUTPUT,
        ),
        "format": Advice(
            Level.WARNING,
            "the messages have other fields than the manual gives",
            "update the firmware of the sensor, or set the asynchronous output to YMR",
        ),
        "device_error": Advice(
            Level.PROBLEM,
            "the sensor reports an error: its output does not fit through the line, or it refuses a command",
            "raise baud_rate in [devices.{device}] and in the sensor (register 5), or lower its output rate "
            "(register 7); end other programs that send to it",
        ),
    },
}
"""Advice where a reason means something else for a type of device than in `_ADVICE`."""
_UNKNOWN = Advice(
    Level.WARNING,
    "the device sends data that its codec rejects",
    "compare the settings in [devices.{device}] with the device's manual",
)


def advice_for(reason: str, device_type: str) -> Advice:
    """Return what a reason means for a type of device, and what to do about it."""
    of_type = _ADVICE_OF_TYPE.get(device_type, {})
    return of_type.get(reason) or _ADVICE.get(reason, _UNKNOWN)


def list_reasons(reception: Reception) -> str:
    """Return how often the codec rejected what; "" when it rejected nothing."""
    return ", ".join(f"{count} x {reason}" for reason, count in sorted(reception.health.rejected.items()))


def check_rejections(reception: Reception) -> list[Finding]:
    """Check what the codec rejected among good data; no finding without good data."""
    accepted = reception.health.accepted
    if not accepted:
        return []
    findings: list[Finding] = []
    for reason, count in sorted(reception.health.rejected.items()):
        advice = advice_for(reason, reception.settings.type)
        tolerated = max(TOLERATED, TOLERATED_SHARE * accepted) if advice.level is Level.WARNING else 0
        if advice.level is not Level.OK and count > tolerated:
            what = f"{count} x '{reason}' with {accepted} good samples"
            fix = advice.fix.format(device=reception.device)
            findings.append(Finding(CHECK, reception.device, advice.level, what, advice.cause, fix))
    return findings
