"""Pose fixes and true poses of a drive, from columns or a table of their own."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.files.array_table import Table
from rover_hil.drives.formats.fixes import invented_poses
from rover_hil.drives.formats.table.columns import (
    SI_PER_UNIT,
    Column,
    FixColumns,
    PlaceColumns,
    TruthColumns,
    angle_unit,
)
from rover_hil.drives.formats.table.drive_table import FIX, DriveTable, Row
from rover_hil.drives.quality.oddities import Oddity

DEGREES = {"deg": 1.0, "1e-7 deg": 1e-7}


def take_truth(source: DriveTable, truth: TruthColumns) -> None:
    """Take the true poses of the rover, from those of its marker; positions where no yaw is measured."""
    t_ns, x_m, y_m, yaw_rad = _places(source, truth)
    has_yaw = truth.yaw is not None
    yaw_rad = yaw_rad if has_yaw else np.zeros(len(x_m))
    invented = invented_poses(x_m, y_m, yaw_rad, source.drive.oddities)
    yaw_rad = yaw_rad - math.radians(truth.marker.yaw_deg)
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    x_m = x_m - (cosine * truth.marker.x_m - sine * truth.marker.y_m)
    y_m = y_m - (sine * truth.marker.x_m + cosine * truth.marker.y_m)
    poses = np.column_stack((x_m, y_m, yaw_rad) if has_yaw else (x_m, y_m)).tolist()
    rows = [
        Row(t, "truth", {"pose": pose})
        for place, (t, pose) in enumerate(zip(t_ns, poses, strict=True))
        if place not in invented
    ]
    _keep(source, rows, truth, "true poses")


def take_fixes(source: DriveTable, fixes: FixColumns) -> None:
    """Take the pose fixes, with their standard deviation where it is given."""
    t_ns, x_m, y_m, yaw_rad = _places(source, fixes)
    std_m = np.full(len(x_m), math.nan)
    if fixes.sigma is not None:
        std_m = _place_numbers(source, fixes, fixes.sigma) * SI_PER_UNIT[fixes.sigma.unit]
    values = np.column_stack((x_m, y_m, yaw_rad, std_m)).tolist()
    rows = [Row(t, "fixes", {"fix": fix}) for t, fix in zip(t_ns, values, strict=True)]
    _keep(source, rows, fixes, "fixes")


def _keep(source: DriveTable, rows: Sequence[Row], place: PlaceColumns, what: str) -> None:
    """Take the rows between the first and the last of the drive, without empty ones."""
    last_ns = source.t_ns[-1]
    rows = [row for row in rows if math.isfinite(next(iter(row.values.values()))[0])]
    kept = [row for row in rows if 0 <= row.t_ns <= last_ns]
    if not kept:
        file = source.table.path if place.file is None else place.file
        if not rows:
            raise LogError(f"{file}: no row holds numbers of the {what}: {FIX}")
        begins_s = rows[0].t_ns / 1e9
        raise LogError(
            f"{file}: none of the {what} lies between the first and the last row of {source.table.path}: "
            f"they begin {begins_s:.6g} s from its first row: two clocks, as of time zones, or a wrong unit: "
            "correct the time columns or their units"
        )
    if len(kept) < len(rows):
        outside = f"{what} before the first or behind the last row"
        source.drive.oddities.append(Oddity(what=outside, count=len(rows) - len(kept)))
    source.drive.rows.extend(kept)


def _place_numbers(source: DriveTable, place: PlaceColumns, column: Column) -> Array:
    table = source.table_of(place)
    values: Array = column.sign * table.numbers(source.name_of(table, column), fix=FIX)
    return values if place.file is not None else values[source.used]


def _places(source: DriveTable, place: PlaceColumns) -> tuple[list[int], Array, Array, Array]:
    """Return times, places and yaws of the marker; NaN where there is none."""
    table, t_ns, used = source.table_of(place), source.t_ns, source.used
    if place.file is not None:
        times_s = source.times_s(table, place.time or source.columns.time)
        used = np.ones(len(times_s), bool)
        t_ns = source.nanoseconds(times_s)
    if place.latitude is not None and place.longitude is not None:
        x_m, y_m = _east_north_m(
            source,
            table,
            np.flatnonzero(used),
            _place_numbers(source, place, place.latitude) * DEGREES[place.latitude.unit],
            _place_numbers(source, place, place.longitude) * DEGREES[place.longitude.unit],
        )
    else:
        assert place.x is not None  # noqa: S101 the model has checked it
        assert place.y is not None  # noqa: S101
        x_m = _place_numbers(source, place, place.x) * SI_PER_UNIT[place.x.unit]
        y_m = _place_numbers(source, place, place.y) * SI_PER_UNIT[place.y.unit]
    if place.yaw is None:
        return t_ns, x_m, y_m, np.full(len(x_m), math.nan)
    numbers = _place_numbers(source, place, place.yaw)
    yaw_rad = (numbers - place.yaw.sign * place.yaw.zero) * angle_unit(place.yaw)
    return t_ns, x_m, y_m, yaw_rad


def _east_north_m(
    source: DriveTable, table: Table, rows: NDArray[np.intp], latitude_deg: Array, longitude_deg: Array
) -> tuple[Array, Array]:
    """Return places from the first one, on its tangent plane.

    Raises:
        LogError: There is none, or these are no latitudes and longitudes.
    """
    from pymap3d import geodetic2enu

    is_unset = (latitude_deg == 0.0) & (longitude_deg == 0.0)
    if is_unset.any() and not is_unset.all():
        what = "positions at latitude 0, longitude 0: the receiver had no position"
        source.drive.oddities.append(Oddity(what=what, count=int(is_unset.sum())))
        latitude_deg = np.where(is_unset, np.nan, latitude_deg)
    known = np.flatnonzero(np.isfinite(latitude_deg) & np.isfinite(longitude_deg))
    if not known.size:
        raise LogError(f"{table.path}: no row holds a latitude and a longitude: {FIX}")
    wrong = np.flatnonzero((np.abs(latitude_deg) > 90.0) | (np.abs(longitude_deg) > 360.0))
    if wrong.size:
        raise LogError(
            f"{table.where(int(rows[wrong[0]]))}: a latitude of {latitude_deg[wrong[0]]:g} and a "
            f"longitude of {longitude_deg[wrong[0]]:g} are none in degrees: {FIX}"
        )
    first = float(latitude_deg[known[0]]), float(longitude_deg[known[0]])
    east_m, north_m, _ = geodetic2enu(latitude_deg, longitude_deg, 0.0, *first, 0.0)
    return east_m, north_m
