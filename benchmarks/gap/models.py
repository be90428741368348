"""Verdicts of the models of `rover-hil gap` on measured data, and how long they take.

`python -m benchmarks.gap.models measured DATA` asks for verdicts on the measured runs
(docs/reference/gap_data.md names their sources), and again with what was named; `speed` times whole verdicts
on 50 drives.
"""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rover_hil.gap.data.load import load_model, read_runs
from rover_hil.gap.findings import Analysis
from rover_hil.gap.output.model_file import ExtendedModel, read_model_file
from rover_hil.gap.output.results import MODEL_NAME, write_results
from rover_hil.gap.verdict import Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Model, Run
from tests.nature import four_wheel_drive, omni_drive

MEASURED = (
    ("robotino-motor", "robotino_2023/motor_identification"),
    ("robotino-drive", "robotino_2023/one_surface_type/table_surface"),
    ("robotino-drive", "robotino_2021/experimental_data_blue.csv"),
    ("single-wheel", "cmu_single_wheel"),
)
DRIVES = 50


def extended(base: Model, analysis: Analysis, name: str) -> Model | None:
    """Return the model with what was named, or None."""
    if not analysis.verdict.effects:
        return None
    with tempfile.TemporaryDirectory() as folder:
        write_results(Path(folder), analysis, name, "")
        return ExtendedModel(base, read_model_file(Path(folder) / MODEL_NAME))


def print_verdict(head: str, runs: Sequence[Run], verdict: Verdict) -> None:
    print(f"{head}, {len(runs)} runs: {verdict.verdict} ({verdict.seconds:.0f} s)")
    print(f"    {verdict.sentence}")
    print(f"    set: {' | '.join('+'.join(names) for names in verdict.confidence_set) or '-'}")
    for unnamed in verdict.unnamed:
        print(f"    without name: {unnamed['equation']}")
    print(flush=True)


def measured(folder: Path) -> None:
    """Print verdicts on measured data, and those of the extended models."""
    for name, place in MEASURED:
        base = load_model(name)
        runs = read_runs(base, folder / place)
        analysis = analyse(base, runs)
        print_verdict(f"{name} on {place}", runs, analysis.verdict)
        more = extended(base, analysis, name)
        if more is not None:
            print_verdict(f"{name} with it on {place}", runs, analyse(more, runs).verdict)


def speed() -> None:
    """Print how long whole verdicts on 50 drives take."""
    rng = np.random.default_rng(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rover = omni_drive.TrueRover(mm_per_px=1.95, slip_per_pull=0.1)
        for index in range(DRIVES):
            table = omni_drive.record(rover, 7.0 * index, 0.1 + 0.1 * (index % 2), rng)
            omni_drive.write(folder / f"exp{index:02}.csv.gz", table)
        _time("robotino-drive", folder)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        soil = four_wheel_drive.draw_soil(rng)
        for index in range(DRIVES):
            site = replace(four_wheel_drive.random_site(rng), way_m=3.0)
            drive = four_wheel_drive.drive(site, soil, four_wheel_drive.Rover(), rng, psi_rad=0.3 * index)
            for end, columns in (("", drive.log), ("_truth", drive.truth)):
                rows = np.stack(list(columns.values()), axis=1)
                path = folder / f"drive{index:02}{end}.csv"
                np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.6g")
        _time("four-wheel-drive", folder)


def _time(name: str, folder: Path) -> None:
    model = load_model(name)
    runs = read_runs(model, folder)
    verdict = analyse(model, runs).verdict
    cards, rows = len(model.effects), sum(run.inputs["t_s"].size for run in runs)
    print(
        f"{name}: {len(runs)} runs of {rows // len(runs)} windows, {cards} effects: {verdict.seconds:.0f} s, "
        f"{verdict.verdict} {verdict.confidence_set}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("measured", "speed"))
    parser.add_argument("data", type=Path, nargs="?", default=Path("../shared/data"))
    arguments = parser.parse_args()
    match arguments.what:
        case "measured":
            measured(arguments.data)
        case _:
            speed()


if __name__ == "__main__":
    main()
