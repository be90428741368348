"""The CMU smooth wheel, blind and fitted: `python -m benchmarks.terrain.cmu_wheel`.

Blind is from plates alone. Then half of the cells (slip angle, rim speed), chosen like one colour of a chess
board, are fitted; which numbers are fitted is chosen by cross-validation within that half. `--write FILE`
writes a soil fitted on all cells.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.terrain.cmu_peers import PUBLISHED, predict, retuned
from rover_hil.terrain.fit import FREE, SoilFit, fit_soil
from rover_hil.terrain.fit_data import WheelTests
from rover_hil.terrain.fit_files import read_cmu_plates, read_cmu_wheel
from sim_backends.terramechanics.soil.any_angle_wheel import (
    AnyAngleSoil,
    any_angle_at_load,
    load_any_angle_soil,
)
from sim_backends.terramechanics.soil.library import load_soil, load_wheel
from sim_backends.terramechanics.soil.pressure_sinkage import PlateTest, fit_plates
from sim_backends.terramechanics.soil.wheel_forces import wheel_at_load

Array = NDArray[np.float64]
DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "cmu_single_wheel"
CORE = (
    "shear_modulus_m",
    "exit_share",
    "slide_number",
    "push_number",
    "wake_rate",
    "wall_number",
    "sideways_exponent",
    "wall_drag",
)
CANDIDATES = {"core": CORE, "core + rim friction": (*CORE, "rim_friction_deg"), "all": tuple(FREE)}
FOLDS = 4
WHEEL = load_wheel("cmu_smooth")


class Errors(NamedTuple):
    """Predicted minus measured; one entry per cell. Forces N, sinkage m."""

    drawbar: Array
    side: Array
    sinkage: Array


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, help="write a soil fitted on all cells")
    arguments = parser.parse_args()
    plates = read_cmu_plates(DATA / "plate_penetration")
    trials = read_cmu_wheel(DATA / "smooth_wheel_steady_state.csv")
    cells = trials.means()
    show_plates(plates)
    train = training_half(cells)
    print(f"\n{train.sum()} cells to train, {(~train).sum()} to test; below: rms of predicted - measured")
    print(f"Replicates scatter by {replicate_scatter(trials)} (N, N, mm)")
    blind = load_any_angle_soil("cmu_sand_blind")
    show_blind(cells, blind)
    names = choose(plates, cells.only(train), blind)
    fit = fit_soil(plates, cells.only(train), WHEEL, blind, names)
    show_fit(fit)
    show_peers(cells, train)
    errors = any_angle_errors(cells, fit.soil)
    show_row("fitted on half", errors, train)
    show_cells(cells, errors, train)
    show_swapped(plates, cells, train, blind, names)
    if arguments.write:
        write(arguments.write, fit_soil(plates, cells, WHEEL, blind, names))


def training_half(cells: WheelTests) -> NDArray[np.bool_]:
    """Return which cells train: the squares of one colour on the board of slip angles and rim speeds."""
    angle = np.unique(cells.slip_angle_deg, return_inverse=True)[1]
    speed = np.unique(cells.rim_speed_mm_s, return_inverse=True)[1]
    return np.asarray((angle + speed) % 2 == 0)


def any_angle_errors(cells: WheelTests, soil: AnyAngleSoil) -> Errors:
    sinkage, forces = any_angle_at_load(WHEEL, soil, cells.motion, cells.load_n)
    return Errors(forces.drawbar_n - cells.drawbar_n, forces.side_n - cells.side_n, sinkage - cells.sinkage_m)


def paper_001_errors(cells: WheelTests) -> Errors:
    """Return errors of paper 001's law with the plates' numbers; NaN outside its domain."""
    rim, forward, sideways = cells.motion
    slip = np.where(rim > forward, 1 - forward / np.maximum(rim, 1e-9), rim / np.maximum(forward, 1e-9) - 1)
    inside = (cells.slip_angle_deg < 88) & (slip > -0.99)
    errors = np.full((3, len(cells.cell)), np.nan)
    sinkage, forces = wheel_at_load(
        WHEEL,
        load_soil("cmu_sand"),
        load_n=cells.load_n[inside],
        slip=slip[inside],
        slip_angle_rad=np.arctan2(sideways, forward)[inside],
    )
    errors[:, inside] = np.stack([forces.drawbar_n, forces.side_n, sinkage])
    return Errors(*(errors - np.stack([cells.drawbar_n, cells.side_n, cells.sinkage_m])))


def choose(plates: list[PlateTest], half: WheelTests, start: AnyAngleSoil) -> tuple[str, ...]:
    """Return the set of numbers with the least cross-validated error of forces."""
    fold = np.random.default_rng(0).permutation(len(half.cell)) % FOLDS
    best: tuple[float, str] = (np.inf, "")
    print("\nCross-validation within the training half: Fx N, Fy N, sinkage mm")
    for label, names in CANDIDATES.items():
        parts = []
        for number in range(FOLDS):
            soil = fit_soil(plates, half.only(fold != number), WHEEL, start, names).soil
            parts.append(np.stack(any_angle_errors(half.only(fold == number), soil)))
        drawbar, side, sinkage = (rms(row) for row in np.concatenate(parts, axis=1))
        print(f"  {label:20} {len(names):2} numbers  {drawbar:6.2f} {side:6.2f} {1000 * sinkage:6.2f}")
        best = min(best, (float(np.hypot(drawbar, side)), label))
    return CANDIDATES[best[1]]


def show_plates(plates: list[PlateTest]) -> None:
    fit = fit_plates(plates)
    print("plate      diameter mm   k kPa/m^n       n")
    for test, modulus, exponent in zip(plates, fit.moduli_pa, fit.exponents, strict=True):
        print(f"{test.name[-1]:>5} {test.diameter_m * 1000:15.0f} {modulus / 1000:11.0f} {exponent:7.3f}")
    size = fit.size_exponent
    assert size is not None
    print("k {:.0f} ({:.0f} .. {:.0f})".format(*(value / 1000 for value in fit.modulus_pa)))
    print(f"n {fit.exponent.value:.3f} ({fit.exponent.lower:.3f} .. {fit.exponent.upper:.3f})")
    print(f"pressure grows with diameter^{size.value:.2f} ({size.lower:.2f} .. {size.upper:.2f})")


def show_blind(cells: WheelTests, blind: AnyAngleSoil) -> None:
    print("\nBlind, all cells:            cells    Fx N   Fy N  sinkage mm")
    for label, errors in (
        ("paper 001, where it holds", paper_001_errors(cells)),
        ("any angle", any_angle_errors(cells, blind)),
    ):
        print(f"  {label:26} {np.isfinite(errors.sinkage).sum():5}  {numbers(errors)}")


def show_fit(fit: SoilFit) -> None:
    print(f"\nFitted on {fit.cells} cells; weighted rms {fit.residual:.2f}; at bounds: {fit.at_bound}")
    for name, interval in fit.intervals.items():
        print(f"  {name:20} {interval.value:10.4g} ({interval.lower:.4g} .. {interval.upper:.4g})")


def show_peers(cells: WheelTests, train: NDArray[np.bool_]) -> None:
    print("\n                                  training half            |  held-out half")
    for side in ("wedge", "ishigami"):
        for label, tuned in (("as published", PUBLISHED), ("retuned", retuned(cells.only(train), side))):
            predicted = predict(cells, tuned, side)
            errors = Errors(
                predicted.drawbar_n - cells.drawbar_n,
                predicted.side_n - cells.side_n,
                predicted.sinkage_m - cells.sinkage_m,
            )
            show_row(f"Pavlov, {side}, {label}", errors, train)


def show_row(label: str, errors: Errors, train: NDArray[np.bool_]) -> None:
    print(f"{label:32} {numbers(errors, train)} | {numbers(errors, ~train)}")


def show_cells(cells: WheelTests, errors: Errors, train: NDArray[np.bool_]) -> None:
    speeds = np.unique(cells.rim_speed_mm_s)
    for title, values in (
        ("Fx N", errors.drawbar),
        ("Fy N", errors.side),
        ("sinkage mm", 1000 * errors.sinkage),
    ):
        print(f"\n{title}: predicted - measured by slip angle (deg) and rim speed (mm/s); * held out")
        print("      " + "".join(f"{speed:8.0f}" for speed in speeds))
        for angle in np.unique(cells.slip_angle_deg):
            row = [
                np.flatnonzero((cells.slip_angle_deg == angle) & (cells.rim_speed_mm_s == v))[0]
                for v in speeds
            ]
            print(f"{angle:5.0f} " + "".join(f"{values[i]:7.1f}{' ' if train[i] else '*'}" for i in row))


def show_swapped(
    plates: list[PlateTest],
    cells: WheelTests,
    train: NDArray[np.bool_],
    start: AnyAngleSoil,
    names: tuple[str, ...],
) -> None:
    errors = any_angle_errors(cells, fit_soil(plates, cells.only(~train), WHEEL, start, names).soil)
    print(f"\nHalves swapped, the same numbers fitted; held-out: {numbers(errors, train)}")


def write(path: Path, fit: SoilFit) -> None:
    lines = [
        "# Dry sand of the CMU single-wheel test bed, fitted to its plates and to all 63 cells of its",
        "# smooth wheel by `python -m benchmarks.terrain.cmu_wheel --write FILE`; comments: 95 % intervals.",
    ]
    for name, value in fit.soil.model_dump().items():
        shown = f'"{SOURCE}"' if name == "source" else f"{value:.6g}"
        interval = fit.intervals.get(name)
        lines.append(
            f"{name} = {shown}" + (f"  # {interval.lower:.3g} .. {interval.upper:.3g}" if interval else "")
        )
    path.write_text("\n".join(lines) + "\n", "utf-8")


SOURCE = "GitHub robomechanics/3d-terramechanics @ 55a6e92: plates and smooth wheel"


def replicate_scatter(trials: WheelTests) -> str:
    means = trials.means()
    row = np.searchsorted(means.cell, trials.cell)
    off = [
        trials.drawbar_n - means.drawbar_n[row],
        trials.side_n - means.side_n[row],
        1000 * (trials.sinkage_m - means.sinkage_m[row]),
    ]
    return ", ".join(f"{rms(values) * np.sqrt(1.5):.2f}" for values in off)


def numbers(errors: Errors, chosen: NDArray[np.bool_] | None = None) -> str:
    drawbar, side, sinkage = (part if chosen is None else part[chosen] for part in errors)
    return f"{rms(drawbar):6.2f} {rms(side):6.2f} {1000 * rms(sinkage):8.2f}"


def rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


if __name__ == "__main__":
    main()
