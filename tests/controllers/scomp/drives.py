"""Simulated field tests as the estimators read them."""

import numpy as np

from rover_hil.drives.ground_truth import TruePoses
from rover_hil.identify.scomp.fit import Identification, identify
from rover_hil.scomp.columns import drive_of
from rover_hil.scomp.drive import SensorRows
from rover_hil.scomp.files import truth_of
from rover_hil.scomp.odometry import Result, estimate_track
from tests.nature.four_wheel_drive import MOUNDS, SIDEWAYS, Recorded, field_test
from tests.once import computed_once

SEED = 11


@computed_once
def sideways() -> Recorded:
    return field_test(SIDEWAYS, SEED)


@computed_once
def mounds() -> Recorded:
    return field_test(MOUNDS, SEED)


def read(recorded: Recorded) -> tuple[SensorRows, TruePoses]:
    return drive_of(recorded.log, "simulated")[0], truth_of(recorded.truth, "simulated")


@computed_once
def fitted() -> Identification:
    return identify(*read(sideways()))


@computed_once
def estimated(which: str, *, online: bool) -> Result:
    """Return a field test with the parameters of the first."""
    recorded = {"sideways": sideways, "mounds": mounds}[which]()
    return estimate_track(read(recorded)[0], fitted().parameters, online=online)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
