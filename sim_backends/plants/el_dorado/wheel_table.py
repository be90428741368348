"""Forces of a soil on a wheel as a table over load, slip, side speed and camber.

Importing this module loads numba; the first table on a machine compiles the wheel forces, about 20 s.
"""

import hashlib
import io
import os
from contextlib import suppress
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np

from drivers.errors import ModelError
from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.compiled import cache_folder, compiled_kernel
from sim_backends.terramechanics.soil.library import SoilSettings, WheelSettings
from sim_backends.terramechanics.soil.quadrature import rule_for
from sim_backends.terramechanics.soil.wheel_contact import wheel_contact
from sim_backends.terramechanics.soil.wheel_forces import sink

LOADS = (0.1, 0.35, 0.75, 1.3, 2.1, 3.6)
"""Loads relative to the mean load of a wheel."""
SLIPS = (
    *(-0.9, -0.7, -0.5, -0.35, -0.24, -0.16, -0.1, -0.06, -0.03, 0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.26),
    *(0.33, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0),
)
SIDES_DEG = (0.0, 1.5, 3.0, 5.0, 8.0, 12.0, 17.0, 23.0, 30.0, 40.0, 52.0, 66.0, 80.0)
CAMBERS_DEG = (-20.0, -10.0, 0.0, 10.0, 20.0)
BOUND = 1e-3


class WheelTable(NamedTuple):
    """Forces relative to the load, for any ratio of the speeds.

    Attributes:
        load_n: Axis of loads on the wheel.
        slip: Axis of slip ratios, negative in skid.
        side_rad: Axis of the arctangent of the sideways speed, to the left, over the faster of rim and
            forward speed.
        camber_rad: Axis of the angle from the surface's normal to the wheel's plane, positive to the left.
        share: Drawbar pull, side force to the left, and torque over radius, as shares of the load; shape
            (loads, slips, sides, cambers, 3).
    """

    load_n: Array
    slip: Array
    side_rad: Array
    camber_rad: Array
    share: Array


def load_table(wheel: WheelSettings, soil: SoilSettings, load_n: float) -> WheelTable:
    """Return the table of `build_table`; it is stored in numba's cache folder and reused."""
    axes = (LOADS, SLIPS, SIDES_DEG, CAMBERS_DEG, BOUND)
    content = f"{wheel.model_dump_json()} {soil.model_dump_json()} {load_n!r} {axes}"
    stored = cache_folder() / f"wheel_table.{hashlib.sha256(content.encode()).hexdigest()[:16]}.npz"
    try:
        with stored.open("rb") as file, np.load(file) as arrays:
            return WheelTable(*(arrays[name] for name in WheelTable._fields))
    except (OSError, ValueError, KeyError, BadZipFile):  # missing or truncated
        table = build_table(wheel, soil, load_n)
    with suppress(OSError):  # without a writable folder the table is computed again each time
        stream = io.BytesIO()
        np.savez_compressed(stream, **table._asdict())
        part = stored.with_suffix(f".{os.getpid()}.part")
        part.write_bytes(stream.getvalue())
        part.replace(stored)
    return table


def build_table(wheel: WheelSettings, soil: SoilSettings, load_n: float) -> WheelTable:
    """Compute the table; takes some seconds.

    Args:
        wheel: Wheel.
        soil: Soil.
        load_n: Mean load on a wheel of the rover; the table reaches from 0.1 to 3.6 times that.

    Raises:
        ModelError: The soil does not bear the wheel.
    """
    load, slip, side = (
        np.array(axis, dtype=np.float64)
        for axis in (np.multiply(LOADS, load_n), SLIPS, np.radians(SIDES_DEG))
    )
    camber = np.radians(np.array(CAMBERS_DEG))
    loads, slips, sides = (grid.ravel() for grid in np.meshgrid(load, slip, side, indexing="ij"))
    # The kernel takes the sideways speed over the rim's, the table over the faster of the two.
    side_speed = np.tan(sides) / np.where(slips < 0.0, 1.0 + slips, 1.0)
    share = np.empty((len(load), len(slip), len(side), len(camber), 3))
    for index, angle in enumerate(camber.tolist()):
        contact = wheel_contact(wheel, soil, camber_rad=angle)
        _, forces = sink(contact, rule_for(BOUND), compiled_kernel, loads, slips, side_speed)
        if np.isnan(forces).any():
            raise ModelError(
                f"the soil does not bear a wheel under {load[-1]:.0f} N: choose another soil or less mass"
            )
        columns = forces[:, (0, 1, 3)] / loads[:, np.newaxis]
        columns[:, 2] /= contact.shearing_radius_m
        share[:, :, :, index] = columns.reshape(*share.shape[:3], 3)
    return WheelTable(load, slip, side, camber, share)
