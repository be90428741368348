"""What the devices complain about by themselves."""

from drivers.can_wheels.faults import BUS
from drivers.samples import BumperSample, FaultSample, PowerSample
from rover_hil.doctor.finding import Finding, ok, problem, warning
from rover_hil.doctor.listening import Heard

CHECK = "device fault"


def check_faults(heard: Heard) -> list[Finding]:
    """Look at faults and the bumper as they were at the end, and at the supply."""
    device = heard.device
    faults = {sample.wheel: sample for sample in heard.samples if isinstance(sample, FaultSample)}
    findings = [_fault(sample) for sample in faults.values() if sample.code]
    bumpers = [sample for sample in heard.samples if isinstance(sample, BumperSample)]
    if bumpers and bumpers[-1].pressed:
        findings.append(
            warning(
                CHECK,
                device,
                "the bumper is pressed",
                "the rover touches something, or the bumper is not plugged in",
                "move the rover away from it; without a bumper set bumper_stops = false in [safety]",
            )
        )
    supplies = [sample for sample in heard.samples if isinstance(sample, PowerSample)]
    if supplies:
        findings.append(ok("supply", device, f"{supplies[-1].voltage_v:.1f} V"))
    return findings


def _fault(sample: FaultSample) -> Finding:
    where = "" if sample.wheel is None else f"wheel {sample.wheel} "
    what = f"{where}reports fault {sample.code}: {sample.text}"
    if sample.wheel is None and sample.text.startswith(BUS):
        cause = "the CAN controller sees errors: wrong bit rate, missing termination, or nobody else on the bus"
        fix = "measure 60 ohm between CAN_H and CAN_L with power off, switch the drives on, compare bit rates"
    else:
        cause = "the device has switched itself into a fault state; the rover will not drive until it clears"
        fix = "look the fault up in the device's manual, remove its cause, switch the device off and on"
    return problem(CHECK, sample.device, what, cause, fix)
