"""`rover-hil identify probe`: slip over the transmission loss of a yaw excitation."""

from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError
from rich.progress import track

from controllers.slip.effort.yaw_excitation import YawExcitationMap
from drivers.errors import ConfigError
from drivers.files import resolved
from rover_hil.app.exit_codes import EXIT_OK
from rover_hil.app.json_text import print_json
from rover_hil.app.options import check_inputs
from rover_hil.datasets.marks import mark_files
from rover_hil.identify.slip.log_runs import read_log_run
from rover_hil.identify.slip.map_file import read_slip_map, write_slip_map
from rover_hil.identify.slip.probe_fit import fit_probe
from rover_hil.identify.slip.run_data import MeasuredRun
from rover_hil.identify.slip.runs import find_runs, log_notes
from rover_hil.pages.atomic_write import check_file
from rover_hil.parallel.calls import open_calls
from rover_hil.terminal import Terminal


def identify_probe(
    logs: Sequence[Path],
    *,
    maps: str,
    amplitude_rad_s: float,
    frequency_hz: float,
    out: Path,
    as_json: bool,
    force: bool = False,
    cluster: str | None = None,
) -> int:
    """Fit the probe to `logs` and write `maps` with it to `out`; returns the exit code.

    Raises:
        ConfigError: `out` exists, the excitation is out of range, `maps` cannot be read, or scikit-learn is
            not installed, or the cluster cannot be used.
        LogError: A log cannot be used, or there is too little excitation in all of them.
    """
    check_file(out, force=force)
    excitation = _excitation(logs, amplitude_rad_s, frequency_hz)
    check_inputs(*logs)
    content = read_slip_map(maps)
    files = find_runs(logs).files
    console = Terminal(stderr=True)
    with open_calls(cluster) as calls:
        found = calls.map_files(_read, files, mark_files)
        runs = list(track(found, "reading", total=len(files), console=console, transient=True))
    probe, rejected = fit_probe(runs, excitation)
    notes = log_notes(runs, rejected)
    write_slip_map(content.model_copy(update={"yaw_probe": probe}), out)
    if as_json:
        record = {"logs": len(runs), **probe.model_dump(by_alias=True), "notes": notes}
        print_json(record)
    else:
        console = Terminal()
        console.print(
            f"{len(runs)} logs: slip follows the transmission loss with a scatter of "
            f"{probe.slip_sd:.3f}; written to {out}",
            soft_wrap=True,
        )
        for note in notes:
            console.print(f"Note: {note}", soft_wrap=True)
    return EXIT_OK


def _read(path: Path) -> MeasuredRun:
    """Return the run in a log; its folder is named by the surface."""
    return read_log_run(path, path.parent.name)


def _excitation(logs: Sequence[Path], amplitude_rad_s: float, frequency_hz: float) -> YawExcitationMap:
    """Return the excitation of the logs, its table not yet fitted."""
    source = f"drives in {', '.join(resolved(path).name for path in logs)}"
    try:
        return YawExcitationMap(
            source=source,
            amplitude_rad_s=amplitude_rad_s,
            frequency_hz=frequency_hz,
            transmission_losses=(0, 1),
            slips=(0, 1),
            slip_sd=1.0,
            directions_rad=(0.0,),
            speed_range_m_s=(0.0, 0.0),
        )
    except ValidationError as error:
        detail = error.errors()[0]
        option = str(detail["loc"][0]).split("_")[0]
        raise ConfigError(f"--{option} {detail['input']:g}: {detail['msg']}") from error
