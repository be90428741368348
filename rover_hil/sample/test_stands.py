"""Samples of tables: tests of a sand, and traverses of a side slope."""

from pathlib import Path

import numpy as np

from rover_hil.terrain.fit_tables import PLATE_COLUMNS, PLATE_TABLE, WHEEL_COLUMNS, WHEEL_TABLE
from sim_backends.models.interface import Run
from sim_backends.models.side_slope.model import make_model
from sim_backends.terramechanics.soil.any_angle_wheel import Motion, any_angle_at_load, load_any_angle_soil
from sim_backends.terramechanics.soil.library import load_wheel

SEED = 1
PLATES_M = {"small": 0.06, "middle": 0.08, "large": 0.10}
PLATE_SCATTER = 0.03
"""Of the modulus from test to test, and half of it from sample to sample."""
SINKAGES_M = np.linspace(0.001, 0.03, 15)
TRUE_MODULUS, TRUE_SHEAR = 1.3, 0.7
"""The sand over the one that the fit starts from."""
ANGLES_DEG = (0.0, 15.0, 30.0, 45.0)
RIM_SPEEDS_M_S = (0.010, 0.015, 0.025)
SPEED_M_S = 0.010
LOAD_N = 20.0
TRIALS = 2
FORCE_SD_N, SINKAGE_SD_M = 0.2, 0.0005
SLOPES_DEG, ROLLS_DEG, REPETITIONS = (5.0, 10.0, 15.0, 20.0), (0.0, 10.0, 20.0), 3
MASS_KG = 23.8
FLOW = {"slope_failure": {"gain": 0.5, "onset": 10.0, "backward_share": 0.25, "load_exponent": 0.5}}
SLOPE_SD = {"slip": 0.004, "slip_angle_deg": 0.15, "sinkage_up_mm": 0.4, "sinkage_down_mm": 0.4}


def write_test_bed(folder: Path) -> None:
    """Write plate and wheel tests in a sand that is stiffer than the one of the library."""
    wheel, start = load_wheel("cmu_smooth"), load_any_angle_soil("cmu_sand_blind")
    soil = start.model_copy(
        update={
            "plate_modulus_pa": TRUE_MODULUS * start.plate_modulus_pa,
            "shear_modulus_m": TRUE_SHEAR * start.shear_modulus_m,
        }
    )
    rng = np.random.default_rng(SEED)
    place = folder / "test_bed"
    place.mkdir()
    plates: list[tuple[object, ...]] = []
    for name, diameter_m in PLATES_M.items():
        for repetition in range(TRIALS):
            modulus_pa = soil.plate_modulus_pa * (1.0 + PLATE_SCATTER * rng.standard_normal())
            area_m2 = np.pi / 4.0 * diameter_m**2
            loads_n = modulus_pa * SINKAGES_M**soil.plate_exponent * area_m2
            loads_n = loads_n * (1.0 + 0.5 * PLATE_SCATTER * rng.standard_normal(SINKAGES_M.size))
            pairs = zip(SINKAGES_M, loads_n, strict=True)
            plates += [(f"{name} {repetition}", diameter_m, f"{z:.5f}", f"{load:.4f}") for z, load in pairs]
    _write(place / PLATE_TABLE, ("test", *PLATE_COLUMNS), plates)
    trials: list[tuple[object, ...]] = []
    for angle_deg in ANGLES_DEG:
        for rim_m_s in RIM_SPEEDS_M_S:
            angle = np.radians([angle_deg])
            motion = Motion(np.array([rim_m_s]), SPEED_M_S * np.cos(angle), SPEED_M_S * np.sin(angle))
            sinkage_m, forces = any_angle_at_load(wheel, soil, motion, np.array([LOAD_N]))
            for _ in range(TRIALS):
                noise = rng.standard_normal(3)
                measured = (
                    forces.drawbar_n[0] + FORCE_SD_N * noise[0],
                    forces.side_n[0] + FORCE_SD_N * noise[1],
                    sinkage_m[0] + SINKAGE_SD_M * noise[2],
                )
                cell = f"{angle_deg:.0f} deg {1e3 * rim_m_s:.0f} mm/s"
                numbers = (f"{value:.5f}" for value in measured)
                trials.append((cell, angle_deg, SPEED_M_S, rim_m_s, LOAD_N, *numbers))
    _write(place / WHEEL_TABLE, ("cell", *WHEEL_COLUMNS), trials)


def write_slope(folder: Path) -> None:
    """Write traverses of a slope whose upper soil flows downhill, which the base model does not contain."""
    model = make_model()
    runs = [
        Run(
            name=f"slope {slope_deg:.0f} roll {roll_deg:.0f} no {number}",
            conditions={"slope_deg": slope_deg, "roll_deg": roll_deg, "mass_kg": MASS_KG},
        )
        for slope_deg in SLOPES_DEG
        for roll_deg in ROLLS_DEG
        for number in range(REPETITIONS)
    ]
    rng = np.random.default_rng(SEED)
    rows: list[tuple[object, ...]] = []
    for run, table in zip(runs, model.predict(runs, {}, FLOW), strict=True):
        measured = (table[name][0] + sd * rng.standard_normal() for name, sd in SLOPE_SD.items())
        rows.append((run.name, *run.conditions.values(), *(f"{value:.5f}" for value in measured)))
    place = folder / "measured"
    place.mkdir()
    _write(place / "summary.csv", ("run", "slope_deg", "roll_deg", "mass_kg", *SLOPE_SD), rows)


def _write(path: Path, columns: tuple[str, ...], rows: list[tuple[object, ...]]) -> None:
    lines = [",".join(map(str, row)) for row in (columns, *rows)]
    path.write_text("\n".join(lines) + "\n", "utf-8")
