"""What the devices complain about by themselves."""

from drivers.can_wheels.faults import BUS
from drivers.samples import BumperSample, FaultSample, PowerSample
from rover_hil.doctor.finding import CAN_WIRING, Finding, ok, problem, warning
from rover_hil.doctor.listening import Heard

CHECK = "device fault"


def check_faults(heard: Heard, *, bumper_stops: bool) -> list[Finding]:
    """Look at faults of drives and buses, at the bumper and at the supply."""
    device = heard.device
    newest = {sample.wheel: sample for sample in heard.samples if isinstance(sample, FaultSample)}
    seen = {
        sample.wheel: sample for sample in heard.samples if isinstance(sample, FaultSample) and sample.code
    }
    findings = [_fault(sample, is_over=newest[wheel].code == 0) for wheel, sample in seen.items()]
    bumpers = [sample for sample in heard.samples if isinstance(sample, BumperSample)]
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
    supplies = [sample for sample in heard.samples if isinstance(sample, PowerSample)]
    if supplies:
        findings.append(ok("supply", device, f"{supplies[-1].voltage_v:.1f} V"))
    return findings


def _fault(sample: FaultSample, *, is_over: bool) -> Finding:
    where = "" if sample.wheel is None else f"wheel {sample.wheel}: "
    what = f"{where}fault {sample.code} ({sample.text}){', now over' if is_over else ''}"
    if "watchdog" in sample.text.lower():
        cause = "no set-points, which is normal here: nobody commands the drive"
        return warning(CHECK, sample.device, what, cause, "nothing to do if the next run drives")
    judge = warning if is_over else problem
    if sample.wheel is None and sample.text.startswith(BUS):
        cause = (
            "error frames of the CAN controller: wrong bit rate, missing termination, nobody else on the bus"
        )
        return judge(CHECK, sample.device, what, cause, CAN_WIRING)
    cause = "the device has put itself into a fault state; the rover does not drive until it clears"
    fix = "look the fault up in the device's manual, remove its cause, switch the device off and on"
    return judge(CHECK, sample.device, what, cause, fix)
