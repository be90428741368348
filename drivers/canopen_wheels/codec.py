"""CANopen drives: configured by SDO one answer at a time, then setpoints and readings in PDOs.

Setpoints other than 0 are sent only when all drives are configured and enabled. What moves a drive towards
operation is sent with each setpoint, by the statusword that it last sent: no thread and no clock are needed,
and a replay gives the same frames.

There is no counter and no time in PDOs: old or lost ones do not show. Not detectable: wrong counts, gear or
velocity unit; a drive that ignores 1016h and so runs on when this computer fails.

Source: see `drivers/canopen_wheels/frames.py`.
"""

import math
import struct
from collections.abc import Callable, Mapping, Sequence

from drivers.can.faults import BusMonitor, FaultBoard
from drivers.can.frame import unpack_can_frame
from drivers.canopen_wheels.frames import (
    BOOT_UP,
    EMCY,
    FAULT_RESET,
    HEARTBEAT,
    NEXT_CONTROLWORD,
    NMT_PRE_OPERATIONAL,
    NMT_START,
    OPERATIONAL,
    PRE_OPERATIONAL,
    SDO_REPLY,
    SHUTDOWN,
    SWITCH_ON,
    TPDO_1,
    TPDO_2,
    State,
    configuration,
    emcy_text,
    heartbeat,
    nmt,
    rpdo_1,
    sdo_download,
    state_of,
)
from drivers.canopen_wheels.parameters import CanopenWheelsParameters
from drivers.driver import Rejection
from drivers.link import Received
from drivers.operation_check import OperationCheck
from drivers.position_counter import PositionCounter, restart_sample
from drivers.samples import FaultSample, Sample, WheelSample
from drivers.speed_check import SPEED_CONTRADICTS_POSITION, SpeedCheck

NOT_A_FRAME = (Rejection("not_a_frame"),)
OTHER_TRAFFIC = (Rejection("other_traffic"),)
OTHER_NODE = (Rejection("other_node"),)
TOO_SHORT = (Rejection("too_short"),)
IMPLAUSIBLE_JUMP = (Rejection("implausible_jump"),)

CALLS_UNTIL_REPEAT = 25
"""Setpoints after which an SDO without an answer is sent again."""
_PLAUSIBLE_OVERSPEED = 1.5
_ABORT = 0x80
_DOWNLOADED = 0x60

_STATUS_SPEED = struct.Struct("<Hi")
_POSITION = struct.Struct("<i")
_CURRENT = struct.Struct("<h")
_EMERGENCY = struct.Struct("<HB")
_KNOWN = frozenset({EMCY, TPDO_1, TPDO_2, SDO_REPLY, HEARTBEAT})


class _Drive:
    """One drive: its scales, and how far it is on its way to operation."""

    def __init__(self, index: int, settings: CanopenWheelsParameters) -> None:
        wheel = settings.wheel[index]
        self.index = index
        self.node = wheel.node
        rpm_per_rad_s = wheel.sign * settings.gear_ratio * 60.0 / math.tau
        self.units_per_rad_s = rpm_per_rad_s * settings.velocity_units_per_rpm
        self.rad_per_count = wheel.sign * math.tau / (settings.gear_ratio * settings.counts_per_motor_turn)
        rated_a = settings.rated_current_a
        self.a_per_step = None if rated_a is None else wheel.sign * rated_a / 1000.0
        counts_per_s = _PLAUSIBLE_OVERSPEED * settings.rpm_limit / 60.0 * settings.counts_per_motor_turn
        self.counter = PositionCounter(2**32, counts_per_s)
        self.speed_check = SpeedCheck(self.rad_per_count, 1.0 / self.units_per_rad_s)
        self.operation = OperationCheck()
        self.objects = configuration(settings, self.node)
        self._resets_allowed = settings.fault_resets
        self.reset()

    def reset(self) -> None:
        """Begin anew after a break of the link."""
        self.counter.reset()
        self.speed_check.reset()
        self.resets_left = self._resets_allowed
        self.may_reset_fault = False
        self.is_off = False
        self.configure()

    def configure(self) -> None:
        """Begin the configuration anew."""
        self.operation.note_stop()
        self.next_object = -1  # first the network state
        self.waited = 0
        self.state = State.NOT_READY
        self.is_started = False
        self.is_operational = False
        self.is_start_missed = False

    @property
    def is_configured(self) -> bool:
        return self.next_object == len(self.objects)

    @property
    def is_enabled(self) -> bool:
        return self.is_started and self.state is State.ENABLED

    def next_frames(self, velocity: int, is_standstill: bool) -> list[bytes]:
        """Return what brings the drive a step further, or its setpoint; nothing when it stays off."""
        if self.is_off:
            return []
        if self.is_configured and not self.is_started:
            self.is_started = True
            return [nmt(NMT_START, self.node)]
        if self.is_configured:
            return [rpdo_1(self.node, self._controlword(is_standstill), velocity)]
        self.waited += 1
        if self.next_object < 0:
            self.next_object, self.waited = 0, CALLS_UNTIL_REPEAT
            return [nmt(NMT_PRE_OPERATIONAL, self.node)]
        if self.waited <= CALLS_UNTIL_REPEAT:
            return []
        self.waited = 0
        return [sdo_download(self.node, self.objects[self.next_object])]

    def note_written(self, index: int, sub: int) -> bool:
        """Note the answer to an SDO; False when it is not the one awaited."""
        if not 0 <= self.next_object < len(self.objects):
            return False
        item = self.objects[self.next_object]
        if (item.object_index, item.sub) != (index, sub):
            return False
        self.next_object += 1
        self.waited = CALLS_UNTIL_REPEAT
        return True

    def note_restart(self) -> None:
        """Configure the drive again, a limited number of times; then it stays off.

        Without its configuration it would not notice that this computer fails, so it never runs on without.
        """
        self.configure()
        self.is_off = not self.resets_left
        self.resets_left = max(0, self.resets_left - 1)

    def note_pre_operational(self) -> bool:
        """Configure a started drive again; returns True for one that was operational before."""
        if not self.is_started:
            return False
        if self.is_operational:
            self.note_restart()
            return True
        # The first of these heartbeats may have crossed with the start; at the second the start was lost.
        if self.is_start_missed:
            self.configure()
        else:
            self.is_start_missed = True
        return False

    def _controlword(self, is_standstill: bool) -> int:
        # A fault is reset by a rising edge: the bit is sent once, then taken back.
        if self.state is State.FAULT and self.may_reset_fault and is_standstill and self.resets_left:
            self.resets_left -= 1
            self.may_reset_fault = False
            return FAULT_RESET
        return NEXT_CONTROLWORD[self.state]


class CanopenWheelsCodec:
    """PDOs, heartbeats and emergencies to samples; wheel speeds to PDOs, heartbeat and configuration.

    TPDO 1 gives the speed, TPDO 2 the position and, with the rated current in the settings, the current.
    Positions count from the drive's own zero. Faults: emergencies, the fault state of a drive, a drive that
    leaves "operation enabled" or does not come to it while setpoints are sent, an object that it refuses, a
    restart, and a drive that is no longer operational.

    Rejections: "not_a_frame"; "other_traffic"; "other_node", a CANopen message of a node that no wheel has;
    "too_short"; "implausible_jump", see `PositionCounter`; "speed_contradicts_position", which accompanies a
    sample, see `SpeedCheck`; "bus_lost_arbitration" and "bus_warning".

    Args:
        name: Name of the device in the configuration.
        settings: Drives, motors and gear.
    """

    def __init__(self, name: str, settings: CanopenWheelsParameters) -> None:
        self.wheel_count = len(settings.wheel)
        self._name = name
        self._host_node = settings.host_node
        self._velocity_limit = round(settings.rpm_limit * settings.velocity_units_per_rpm)
        self._drives = [_Drive(index, settings) for index in range(self.wheel_count)]
        self._drive_of_node = {drive.node: drive for drive in self._drives}
        self._board = FaultBoard(name)
        self._bus_monitor = BusMonitor(self._board)
        self._readers: Mapping[int, Callable[[int, _Drive, bytes], Sequence[Sample | Rejection]]] = {
            TPDO_1: self._read_status,
            TPDO_2: self._read_position,
            EMCY: self._read_emergency,
            SDO_REPLY: self._read_sdo,
            HEARTBEAT: self._read_heartbeat,
        }

    def reset(self) -> None:
        """Forget turns and configuration; faults that are still active are reported again."""
        self._board.reset()
        for drive in self._drives:
            drive.reset()

    def decode(self, item: Received[bytes]) -> Sequence[Sample | Rejection]:
        """Return the samples and rejections of one frame."""
        frame = unpack_can_frame(item.payload)
        if frame is None:
            return NOT_A_FRAME
        if frame.is_error:
            return self._bus_monitor.note_error(item.t_ns, frame)
        recovered = self._bus_monitor.note_frame(item.t_ns)
        function, node = frame.can_id & 0x780, frame.can_id & 0x7F
        if frame.is_extended or frame.is_remote or function not in _KNOWN or not node:
            return (*recovered, *OTHER_TRAFFIC)
        drive = self._drive_of_node.get(node)
        if drive is None:
            return (*recovered, *OTHER_NODE)
        try:
            return (*recovered, *self._readers[function](item.t_ns, drive, frame.data))
        except struct.error:
            return (*recovered, *TOO_SHORT)

    def encode_start(self) -> Sequence[bytes]:
        """Return nothing, and allow each drive one reset of a fault while zero speeds are commanded.

        Drives are configured and switched on step by step with the setpoints. `WheelDrive` decides when and
        how often a fault is followed by a new start.
        """
        for drive in self._drives:
            drive.may_reset_fault = True
        return ()

    def encode_speeds(self, speed_rad_s: Sequence[float]) -> tuple[Sequence[bytes], tuple[float, ...]]:
        """Return this program's heartbeat, the next step of each drive, and the speeds that this means.

        Speeds are 0 until all drives are enabled.
        """
        payloads = [heartbeat(self._host_node)]
        is_standstill = not any(speed_rad_s)
        may_turn = all(drive.is_enabled for drive in self._drives)
        meant = []
        for drive, speed in zip(self._drives, speed_rad_s, strict=True):
            limit = self._velocity_limit
            velocity = round(min(max(speed * drive.units_per_rad_s, -limit), limit)) if may_turn else 0
            drive.operation.note_set_point()
            payloads += drive.next_frames(velocity, is_standstill)
            meant.append(velocity / drive.units_per_rad_s)
        return payloads, tuple(meant)

    def encode_stop(self) -> Sequence[bytes]:
        """Return the controlword that takes each drive out of operation.

        An enabled drive gets "disable operation": it slows down on its ramp first (object 605Ch; its default
        in CiA 402). "Shutdown" would by default switch the motor off at speed (605Bh); it goes to drives
        that are not enabled. The drive then misses this program's heartbeat, a fault, and stays off.
        """
        for drive in self._drives:
            drive.operation.note_stop()
        return [
            rpdo_1(drive.node, SWITCH_ON if drive.state is State.ENABLED else SHUTDOWN, 0)
            for drive in self._drives
        ]

    def encode_emergency_stop(self) -> Sequence[bytes]:
        """Return "disable operation" with speed 0 for each drive: an enabled one slows down on its ramp.

        The drive then misses this program's heartbeat, as after `encode_stop`.
        """
        return [rpdo_1(drive.node, SWITCH_ON, 0) for drive in self._drives]

    def _read_status(self, t_ns: int, drive: _Drive, data: bytes) -> Sequence[Sample | Rejection]:
        statusword, velocity = _STATUS_SPEED.unpack_from(data)
        drive.state = state_of(statusword)
        drive.is_operational = drive.is_started  # PDOs come in no other state
        if drive.is_enabled:
            drive.may_reset_fault = False  # the start has had its effect; a later fault awaits the next one
        is_at_fault = drive.operation.is_at_fault(t_ns, is_operating=drive.state is State.ENABLED)
        code = statusword if is_at_fault or drive.state is State.FAULT else 0
        state = drive.state.name.lower().replace("_", " ")
        text = "fault" if drive.state is State.FAULT else f"the drive does not obey setpoints: {state}"
        speed_rad_s = velocity / drive.units_per_rad_s
        drive.speed_check.note_speed(speed_rad_s)
        return (
            *self._report(t_ns, drive, "state", code, text),
            WheelSample(device=self._name, t_ns=t_ns, wheel=drive.index, speed_rad_s=speed_rad_s),
        )

    def _read_position(self, t_ns: int, drive: _Drive, data: bytes) -> Sequence[Sample | Rejection]:
        (raw,) = _POSITION.unpack_from(data)
        current_a = None
        if drive.a_per_step is not None:
            current_a = _CURRENT.unpack_from(data, _POSITION.size)[0] * drive.a_per_step
        counts = drive.counter.count(t_ns, raw)
        if counts is None:
            drive.speed_check.reset()
            return IMPLAUSIBLE_JUMP
        sample = WheelSample(
            device=self._name,
            t_ns=t_ns,
            wheel=drive.index,
            position_rad=counts * drive.rad_per_count,
            current_a=current_a,
        )
        results: list[Sample | Rejection] = [sample]
        if drive.counter.has_restarted:
            results.insert(0, restart_sample(self._name, t_ns, f"wheel {drive.index}"))
        if drive.speed_check.contradicts(t_ns, counts * drive.rad_per_count):
            results.append(SPEED_CONTRADICTS_POSITION)
        return results

    def _read_emergency(self, t_ns: int, drive: _Drive, data: bytes) -> Sequence[Sample | Rejection]:
        code, _ = _EMERGENCY.unpack_from(data)
        is_over = code & 0xFF00 == 0
        return self._report(t_ns, drive, "emergency", 0 if is_over else code, emcy_text(code))

    def _read_sdo(self, t_ns: int, drive: _Drive, data: bytes) -> Sequence[Sample | Rejection]:
        command, index, sub, value = struct.unpack_from("<BHBI", data)
        if command == _ABORT:
            return self._report(
                t_ns, drive, "SDO", value, f"object {index:04X}h:{sub:02X} refused, abort code 0x{value:08X}"
            )
        if command != _DOWNLOADED or not drive.note_written(index, sub):
            return OTHER_TRAFFIC
        return self._report(t_ns, drive, "SDO", 0, "")

    def _read_heartbeat(self, t_ns: int, drive: _Drive, data: bytes) -> Sequence[Sample | Rejection]:
        (state,) = struct.unpack_from("B", data)
        if state == OPERATIONAL and drive.is_configured:
            drive.is_operational = drive.is_started
            return self._report(t_ns, drive, "network", 0, "")
        if state == BOOT_UP and drive.next_object > 0:
            drive.note_restart()
            return self._report(t_ns, drive, "network", 1, "restarted")
        if state == PRE_OPERATIONAL and drive.note_pre_operational():
            return self._report(t_ns, drive, "network", 2, "no longer operational")
        return ()

    def _report(self, t_ns: int, drive: _Drive, source: str, code: int, text: str) -> tuple[FaultSample, ...]:
        fault = self._board.report(
            t_ns, drive.index, f"node {drive.node} {source}", code, text if code else ""
        )
        return () if fault is None else (fault,)
