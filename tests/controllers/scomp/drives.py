"""Simulated field tests as the estimators read them."""

from functools import cache

import numpy as np

from rover_hil.identify.scomp.fit import Identification, identify
from rover_hil.scomp.columns import drive_of
from rover_hil.scomp.drive import Drive, TruePath
from rover_hil.scomp.odometry import Result, estimate_track
from tests.nature.four_wheel_drive import MOUNDS, SIDEWAYS, Recorded, field_test

SEED = 11


@cache
def sideways() -> Recorded:
    return field_test(SIDEWAYS, SEED)


@cache
def mounds() -> Recorded:
    return field_test(MOUNDS, SEED)


def read(recorded: Recorded) -> tuple[Drive, TruePath]:
    truth = recorded.truth
    path = TruePath(t_s=truth["t_s"], x_m=truth["x_m"], y_m=truth["y_m"], psi_rad=truth["psi_rad"])
    return drive_of(recorded.log, "simulated")[0], path


@cache
def fitted() -> Identification:
    return identify(*read(sideways()))


@cache
def estimated(which: str, *, online: bool) -> Result:
    """Return a field test with the parameters of the first."""
    recorded = {"sideways": sideways, "mounds": mounds}[which]()
    return estimate_track(read(recorded)[0], fitted().parameters, online=online)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
