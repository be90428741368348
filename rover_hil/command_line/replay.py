"""`rover-hil replay`: run a log again and say what came out different."""

from pathlib import Path

from pydantic_core import to_json
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from drivers.clock import seconds
from drivers.errors import LogError
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.log_reader import LogReader
from rover_hil.recording.replay import ReplayResult, replay
from rover_hil.report.write import write_report


def replay_log(path: Path, *, out: Path | None, as_json: bool) -> int:
    """Replay the log at `path`; returns the exit code.

    Raises:
        LogError: The log cannot be read.
        ConfigError: The folder for the report cannot be used.
    """
    log = LogReader(path)
    with restore_config(log) as config, Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("replaying", total=path.stat().st_size)
        result = replay(log, config, lambda: progress.update(task, completed=log.bytes_read))
    if result.cycles == 0:
        msg = f"log {path} holds no complete cycle"
        raise LogError(msg)
    if as_json:
        Console().out(to_json({**_record(result), "log_is_complete": log.is_complete}).decode())
    else:
        _print_words(result, log)
    if out is not None:
        write_report(path, out)
        if not as_json:
            Console().print(f"report: {out / 'report.html'}")
    return 0 if result.difference_count == 0 else 1


def _record(result: ReplayResult) -> dict[str, object]:
    return {
        "identical": result.difference_count == 0,
        "cycles": result.cycles,
        "difference_count": result.difference_count,
        "differences": result.differences,
    }


def _print_words(result: ReplayResult, log: LogReader) -> None:
    console = Console()
    if not log.is_complete:
        console.print(f"{log.path} was cut off; everything up to the cut was replayed")
    if result.difference_count == 0:
        console.print(f"{result.cycles} cycles replayed, every output identical")
        return
    table = Table("time", "field", "recorded", "replayed", title="what came out different")
    for difference in result.differences:
        time_s = seconds(difference.t_ns - log.start_ns)
        table.add_row(f"{time_s:.3f} s", difference.field, str(difference.recorded), str(difference.replayed))
    console.print(table)
    console.print(f"{result.difference_count} differences in {result.cycles} cycles")
