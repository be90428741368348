"""Forces on a wheel over slip and slip angle, as a table."""

import math
from collections.abc import Sequence

import numpy as np

from rover_hil.terrain.table import Cell, Table, number
from sim_backends.terramechanics.soil.library import SoilSettings, WheelSettings
from sim_backends.terramechanics.soil.wheel_forces import wheel_at_load

COLUMNS = ("load_n", "slip", "slip_angle_deg", "sinkage_m", "drawbar_n", "side_n", "torque_nm", "reason")
NOT_BORNE = "the wheel sinks to its axle: the soil does not bear the load"


def wheel_table(
    wheel: WheelSettings,
    soil: SoilSettings,
    loads_n: Sequence[float],
    slips: Sequence[float],
    slip_angles_deg: Sequence[float],
    camber_deg: float = 0.0,
    cross_slope_deg: float = 0.0,
) -> Table:
    """Return sinkage and forces of a wheel for all combinations, the last list running fastest.

    Args:
        wheel: Wheel.
        soil: Soil.
        loads_n: F_z, more than 0.
        slips: -0.99 (skid) to 1.
        slip_angles_deg: beta, positive to the left.
        camber_deg: From the surface's normal to the wheel's plane, positive to the left.
        cross_slope_deg: Of the surface across the wheel, rising to the left.

    Raises:
        ModelError: A number is outside its range.
    """
    grid = np.meshgrid(loads_n, slips, slip_angles_deg, indexing="ij")
    load_n, slip, angle_deg = (axis.ravel() for axis in grid)
    sinkage_m, forces = wheel_at_load(
        wheel,
        soil,
        load_n=load_n,
        slip=slip,
        slip_angle_rad=np.radians(angle_deg),
        camber_rad=math.radians(camber_deg),
        cross_slope_rad=math.radians(cross_slope_deg),
    )
    columns = (load_n, slip, angle_deg, sinkage_m, forces.drawbar_n, forces.side_n, forces.torque_nm)
    rows: list[tuple[Cell, ...]] = [
        (*map(number, row), NOT_BORNE if math.isnan(row[COLUMNS.index("sinkage_m")]) else "")
        for row in np.stack(columns, axis=1)
    ]
    return Table("wheel", "Forces on a wheel at given load", COLUMNS, rows, keys=3)
