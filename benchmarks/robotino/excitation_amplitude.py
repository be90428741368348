"""Would a second amplitude of the yaw excitation tell a slow gyro from a soft contact?

    python -m benchmarks.robotino.excitation_amplitude [--seconds 25]

The rover of `tests/nature/omni_contact.py` drives on one floor of each contact law, with a fast gyro and with
one behind a low-pass of 20 Hz, excited with 0.2 and with 0.5 rad/s. Printed for each: share of the wheels'
excitation that the gyro shows while the rover travels, and in place, each with the standard deviation of a
window of half a second. A test of the amplitude compares the two rows of a pair.
"""

import argparse
import sys
from contextlib import closing
from unittest.mock import patch

import numpy as np

from benchmarks.robotino.yaw_probe_faults import GROUNDS, Fault, configure, spoil
from controllers.slip.effort.excited_slip import ExcitedSlip, RoverSlip
from controllers.slip.effort.ground_knowledge import KnownSlip
from controllers.slip.effort.yaw_excitation import ExcitationResponse
from drivers.clock import VirtualClock, nanoseconds
from drivers.link import NoTap
from rover_hil.config import Config
from rover_hil.run.composition import build_virtual_rig
from tests.nature.omni_contact import LAWS, Floor, OmniContact

AMPLITUDES_RAD_S = (0.2, 0.5)
GYROS = {"fast gyro": Fault(), "low-pass 20 Hz": Fault(low_pass_hz=20.0)}
CONTACT = (0.7, 4.0, 0.05, 0.15)
"""Limit of the force over the load, its slope over the slip, drag along and across."""
RELAXATION_M = 0.001
IN_PLACE_M_S, TRAVEL_M_S = 0.03, 0.10


def excited_with(amplitude_rad_s: float) -> Config:
    """Return the shipped rover with the yaw probe and another amplitude."""
    config = configure(GROUNDS[2], 0, probe=True, gyro=None)
    assert config.slip is not None
    assert config.slip.maps.yaw_probe is not None
    probe = config.slip.maps.yaw_probe.model_copy(update={"amplitude_rad_s": amplitude_rad_s})
    maps = config.slip.maps.model_copy(update={"yaw_probe": probe})
    return config.model_copy(update={"slip": config.slip.model_copy(update={"maps": maps})})


def shares(law: str, fault: Fault, amplitude_rad_s: float, duration_s: float) -> np.ndarray:
    """Return rows of speed in m/s and share of the excitation, one for each window with a result."""
    found: list[tuple[float, float]] = []
    take = ExcitedSlip.take

    def watched(
        self: ExcitedSlip, response: ExcitationResponse, travelled_m: complex, known: KnownSlip | None
    ) -> RoverSlip:
        if not response.reason:
            found.append((abs(travelled_m) / 0.5, abs(response.share)))
        return take(self, response, travelled_m, known)

    config, clock = excited_with(amplitude_rad_s), VirtualClock()
    rig, world = build_virtual_rig(config, clock, NoTap())
    spoil(world, fault, OmniContact(Floor.uniform(law, RELAXATION_M, CONTACT), clock.now_ns()))
    rig.connect(1.0)
    with closing(rig), patch.object(ExcitedSlip, "take", watched):
        for _ in range(round(duration_s * config.loop.rate_hz)):
            clock.sleep_until(clock.now_ns() + nanoseconds(1.0 / config.loop.rate_hz))
            rig.cycle(clock.now_ns())
    return np.array(found)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=25.0)
    arguments = parser.parse_args()
    print("| contact law, gyro | amplitude, rad/s | share while travelling | share in place |")
    print("|---|---|---|---|")
    for law in LAWS:
        for name, fault in GYROS.items():
            for amplitude_rad_s in AMPLITUDES_RAD_S:
                rows = shares(law, fault, amplitude_rad_s, arguments.seconds)
                cells = []
                for used in (rows[:, 0] > TRAVEL_M_S, rows[:, 0] < IN_PLACE_M_S):
                    share = rows[used, 1]
                    cells.append(f"{share.mean():.3f} ({share.std():.3f})" if len(share) else "-")
                print(f"| {law}, {name} | {amplitude_rad_s:g} | {cells[0]} | {cells[1]} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
