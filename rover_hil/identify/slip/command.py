"""`rover-hil identify slip`: slip maps from measured runs."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from controllers.slip.effort.motor_model import MotorSettings
from drivers.errors import LogError
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ClusterOption, ForceOption, JsonOption, check_inputs, out_option
from rover_hil.console.steps import show_progress
from rover_hil.identify.slip.identification import (
    Errors,
    SlipIdentification,
    identify_slip_maps,
    read_all,
)
from rover_hil.identify.slip.map_file import slip_map_file, write_slip_map
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.report import print_result, result_record
from rover_hil.identify.slip.runs import RunFiles, find_runs, log_notes
from rover_hil.identify.slip.scores import score_runs
from rover_hil.pages.atomic_write import check_file
from rover_hil.parallel.calls import open_calls
from rover_hil.terminal import Terminal


def identify_slip(
    train: Annotated[list[Path], typer.Argument(help="Logs, measured CSV files or folders to learn from.")],
    *,
    test: Annotated[list[Path] | None, typer.Option(help="Logs, files or folders to test on.")] = None,
    out: Annotated[Path | None, out_option("Write the best map to this TOML file.")] = None,
    cluster: ClusterOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Fit slip maps, how much each wheel slips for the effort it takes, and compare them.

    Example: `rover-hil identify slip floors --test floors_test --out floors.toml`

    Data: `rover-hil sample floors` writes these folders; measured ones are in `datasets` of
    github.com/BrOleg5/research-wheel-slippage.
    """
    test = test or []
    check_file(out, force=force)
    check_inputs(*train, *test)
    motor = MotorSettings()
    train_files = find_runs(train)
    test_files = {str(path): find_runs([path]) for path in test}
    with open_calls(cluster) as calls, show_progress() as progress:
        count = len(train_files.files) + sum(len(maps_found.files) for maps_found in test_files.values())
        task = progress.add_task("identifying", total=count + SLIP_FIT.validation.folds + 1)

        def advance() -> None:
            progress.advance(task)

        used = read_all(train_files.files, motor, advance, calls)
        maps_found = identify_slip_maps(used, advance, calls)
        tests: dict[str, Errors] = {}
        for name, files in test_files.items():
            runs = read_all(files.files, motor, advance, calls)
            if maps_found.scale.mm_per_px is None and any(run.camera_in_pixels for run in runs):
                raise LogError(
                    f"{name} is in pixels, but no training run gives a camera scale: train on such runs too"
                )
            tests[name] = score_runs(maps_found.maps, runs, maps_found.scale.m_per_px)
            used = [*used, *runs]
    rejected = sum((Counter(run.rejected) for run in used), Counter[str]())
    notes = [*_notes(maps_found, train_files, test_files), *log_notes(used, rejected)]
    if as_json:
        print_json(result_record(maps_found, tests, notes))
    else:
        print_result(Terminal(), maps_found, tests, notes)
    if out is not None:
        write_slip_map(slip_map_file(maps_found, motor, train), out)
    return EXIT_OK


def _notes(
    identification: SlipIdentification, train_files: RunFiles, test_files: dict[str, RunFiles]
) -> list[str]:
    notes: list[str] = []
    other_files = [*train_files.other_files, *(p for files in test_files.values() for p in files.other_files)]
    if other_files:
        names = ", ".join(sorted({path.name for path in other_files}))
        notes.append(f"not used, no runs: {names}")
    if identification.left_out:
        names = ", ".join(sorted({run.surface for run in identification.left_out}))
        notes.append(f"{len(identification.left_out)} runs on several surfaces are not trained on: {names}")
    if identification.not_validated:
        count = f"{identification.not_validated} of {len(identification.trained_on)}"
        notes.append(f"{count} runs are not cross-validated: too little remains without them")
    for name, files in test_files.items():
        both = len(set(files.files) & {run.path for run in identification.trained_on})
        if both:
            notes.append(
                f"{both} of {len(files.files)} runs in {name} are also trained on: not an independent test"
            )
    return notes
