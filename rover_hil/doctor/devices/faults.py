"""Check the faults that the devices report themselves."""

from drivers.can.faults import BUS
from drivers.samples import BumperSample, FaultSample, PowerSample
from rover_hil.doctor.devices.listening import Reception
from rover_hil.doctor.finding import CAN_WIRING, Finding, ok, problem, warning

CHECK = "device fault"


def check_faults(reception: Reception, *, bumper_stops: bool) -> list[Finding]:
    """Check faults of drives and buses, the bumper and the supply."""
    device = reception.device
    newest = {sample.wheel: sample for sample in reception.samples if isinstance(sample, FaultSample)}
    seen = {
        sample.wheel: sample
        for sample in reception.samples
        if isinstance(sample, FaultSample) and sample.code
    }
    findings = [_fault(sample, is_over=newest[wheel].code == 0) for wheel, sample in seen.items()]
    bumpers = [sample for sample in reception.samples if isinstance(sample, BumperSample)]
    if bumper_stops and bumpers and bumpers[-1].pressed:
        findings.append(
            warning(
                CHECK,
                device,
                "the bumper is pressed: the rover will not start",
                "the rover touches something, or the bumper is not plugged in",
                "move the rover away; on a rover without bumper set bumper_stops = false in [safety]",
            )
        )
    supplies = [sample for sample in reception.samples if isinstance(sample, PowerSample)]
    if supplies:
        findings.append(ok("supply", device, f"{supplies[-1].voltage_v:.1f} V"))
    return findings


def _fault(sample: FaultSample, *, is_over: bool) -> Finding:
    where = "" if sample.wheel is None else f"wheel {sample.wheel}: "
    what = f"{where}fault {sample.code} ({sample.text}){', now cleared' if is_over else ''}"
    if "watchdog" in sample.text.lower():
        cause = "no setpoints, which is normal here: the doctor does not command the drive"
        return warning(CHECK, sample.device, what, cause, "no fix needed if the next run drives")
    report = warning if is_over else problem
    if sample.wheel is None and sample.text.startswith(BUS):
        cause = "error frames: wrong bit rate, missing termination, or no other node on the bus"
        return report(CHECK, sample.device, what, cause, CAN_WIRING)
    cause = "the device is in a fault state; the rover does not drive until it clears"
    fix = "look the fault up in the device's manual, remove its cause, switch the device off and on"
    return report(CHECK, sample.device, what, cause, fix)
