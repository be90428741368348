"""Reads plate and wheel tests from the files of the CMU single-wheel test bed.

Source: GitHub robomechanics/3d-terramechanics @ 55a6e92 (MIT-style licence), as CSV; see
benchmarks/results/terrain.md.
"""

from pathlib import Path

import numpy as np

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.terrain.fit_data import WheelTests
from sim_backends.terramechanics.soil.any_angle_wheel import Motion
from sim_backends.terramechanics.soil.pressure_sinkage import PlateTest

FIX = "give the files of the test bed"
PLATE_DIAMETERS_M = {1: 0.06, 2: 0.06, 3: 0.06, 4: 0.1, 5: 0.1, 6: 0.1, 7: 0.08, 8: 0.08, 9: 0.08}
"""Round plates of the tests 1 to 9."""
REST_SAMPLES = 200
"""Samples before the plate moves, for the force sensor's zero."""
TOUCH_N = 1.5
"""Force above which the plate touches the soil: some 25 standard deviations of the sensor."""
SMOOTHING = 10
"""Samples of the running mean of the force."""
LEAST_SINKAGE_M = 1e-3
LARGEST_SHARE = 0.97
"""Part of the stroke that counts: at its end the plate stops and the force relaxes."""


def read_cmu_plates(folder: Path) -> list[PlateTest]:
    """Return the nine tests with round plates.

    The surface is where the force first stays above `TOUCH_N`; the clocks of force and position differ by
    whole hours and are matched so.

    Args:
        folder: With `force-displacement_N.txt.gz` and `force-displacement_N_ft.csv.gz`.

    Raises:
        LogError: A file is missing or not as described.
    """
    return [_read_plate(folder, number, size) for number, size in PLATE_DIAMETERS_M.items()]


def read_cmu_wheel(path: Path) -> WheelTests:
    """Return the steady trials of the smooth wheel.

    The file's lateral force resists the sideways motion; here forces to the left are positive and the wheel
    slides to the left, so the sign changes. The measured slip angle at a commanded 0 is kept at 0.

    Args:
        path: Of `smooth_wheel_steady_state.csv`.

    Raises:
        LogError: The file is missing or lacks a column.
    """
    cells = read_csv(path)
    cells.require(_WHEEL_COLUMNS, FIX)
    table = {name: cells.numbers(name, fix=FIX, is_needed=True) for name in _WHEEL_COLUMNS}
    angle = np.radians(table["beta_deg"])
    speed = table["V_mm_s"] / 1000.0
    motion = Motion(table["r_omega_mm_s"] / 1000.0, speed * np.cos(angle), speed * np.sin(angle))
    return WheelTests(
        cell=np.array(
            [f"{a:g} deg, {v:g} mm/s" for a, v in zip(table["beta_deg"], table["Vry_cmd_mm_s"], strict=True)]
        ),
        slip_angle_deg=table["beta_deg"],
        rim_speed_mm_s=table["Vry_cmd_mm_s"],
        motion=motion,
        load_n=table["Fz_load_N"],
        drawbar_n=table["Fx_tractive_N"],
        side_n=-table["Fy_lateral_N"],
        sinkage_m=table["sinkage_mm"] / 1000.0,
    )


_WHEEL_COLUMNS = (
    "beta_deg",
    "Vry_cmd_mm_s",
    "V_mm_s",
    "r_omega_mm_s",
    "Fx_tractive_N",
    "Fy_lateral_N",
    "Fz_load_N",
    "sinkage_mm",
)


def _read_plate(folder: Path, number: int, diameter_m: float) -> PlateTest:
    name = f"force-displacement_{number}"
    try:
        position = _table(folder / f"{name}.txt.gz", skip=0)
        force = _table(folder / f"{name}_ft.csv.gz", skip=1)
        height_mm, clock_s = position[:, 4], position[:, 6]
        time_s, raw_n = force[:, 0], -force[:, 3]
    except (IndexError, ValueError) as error:
        raise LogError(f"{folder / name}: is no plate test ({error}); give the test bed's files.") from None
    hours = round((time_s[0] - clock_s[0]) / 3600.0)
    down_m = -np.interp(time_s, clock_s + 3600.0 * hours, height_mm) / 1000.0
    load_n = np.convolve(raw_n - np.median(raw_n[:REST_SAMPLES]), np.ones(SMOOTHING) / SMOOTHING, "same")
    peak = int(np.argmax(load_n))
    touch = int(np.flatnonzero(load_n[:peak] < TOUCH_N)[-1])
    sinkage = down_m[touch : peak + 1] - down_m[touch]
    used = (sinkage > LEAST_SINKAGE_M) & (sinkage < LARGEST_SHARE * sinkage.max())
    area_m2 = np.pi / 4.0 * diameter_m**2
    return PlateTest(name, diameter_m, sinkage[used], load_n[touch : peak + 1][used] / area_m2)


def _table(path: Path, skip: int) -> Array:
    cells = read_csv(path, header_lines=skip)
    return np.column_stack([cells.numbers(name, fix=FIX, is_needed=True) for name in cells.names])
