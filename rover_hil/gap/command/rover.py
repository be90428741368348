"""`rover-hil gap rover`: whose wheels are compared with which drives."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

from drivers.errors import ConfigError
from rover_hil.config import Config, load_config
from rover_hil.drives.drive import drive_name
from rover_hil.drives.formats.described_rover import columns_at, is_log, load_rover
from rover_hil.drives.formats.table.columns import rover_of
from rover_hil.gap.command.find import Subject, say
from rover_hil.gap.data.described_wheels import DescribedWheels, wheels_by_config, wheels_by_geometry
from rover_hil.gap.data.logs import find_logs
from rover_hil.gap.data.rover_logs import read_rover_runs
from rover_hil.gap.data.rover_tables import check_wheels_measured, tables_as_logs
from rover_hil.parallel.calls import open_calls
from sim_backends.models.interface import Model, Run

Logs = Callable[[], AbstractContextManager[Sequence[Path]]]


def rover_subject(source: str, data: Sequence[Path], cluster: str | None = None) -> Subject:
    """Return the wheels of a rover and its drives.

    Args:
        source: A configuration; a file of columns; or a log, or a folder of logs, which know their rover.
        data: Logs and folders of them; tables, too, where the source is a file of columns.
        cluster: Where logs are read.

    Raises:
        ConfigError: The rover is not described by its wheels, or there are no drives.
        LogError: The log cannot be read.
    """
    if is_log(source):
        return _by_log(Path(source), data, cluster)
    if not data:
        raise ConfigError(f"gap rover {source}: name the logs of its drives, and folders of them")
    columns = columns_at(source)
    if columns is None:
        config = load_config(source)
        others = _others(source, config, data)
        return _subject(source, data, wheels_by_config(source, config), lambda: nullcontext(others), cluster)
    check_wheels_measured(columns, source)
    config = rover_of(columns, Path(source))
    logs: Logs = partial(tables_as_logs, data, columns, config, lambda text: say(f"Note: {text}"))
    return _subject(source, data, wheels_by_config(source, config), logs, cluster)


def _others(source: str, config: Config, data: Sequence[Path]) -> Sequence[Path]:
    """Return the logs without those that [simulation] was made from: by them it would seem right.

    Raises:
        ConfigError: There is no other.
    """
    found = None if config.simulation is None else config.simulation.found
    if found is None:
        return data
    files = [file for path in data for file in find_logs(path)]
    others = [file for file in files if drive_name(file.resolve()) not in found.drives]
    if files and not others:
        raise ConfigError(
            f"gap rover {source}: [simulation.found] was made from these drives, so that they cannot judge "
            "it: give logs of other drives"
        )
    if len(others) < len(files):
        names = ", ".join(drive_name(file.resolve()) for file in files if file not in others)
        say(f"Note: left out, because [simulation.found] was made from them: {names}")
    return others or data


def _by_log(first: Path, others: Sequence[Path], cluster: str | None) -> Subject:
    paths = [first, *others]
    files = find_logs(first)
    if not files:
        raise ConfigError(f"{first} holds no log: give run.mcap files of the rover, or folders of them")
    config: Config = load_rover(str(files[0]))
    found = wheels_by_geometry(str(files[0]), config)
    return _subject(str(first), paths, found, lambda: nullcontext(paths), cluster, is_same_rover=True)


def _subject(
    name: str,
    data: Sequence[Path],
    found: DescribedWheels,
    logs: Logs,
    cluster: str | None,
    *,
    is_same_rover: bool = False,
) -> Subject:
    def read(_: Model) -> list[Run]:
        with logs() as paths, open_calls(cluster) as calls:
            return read_rover_runs(found.model, paths, calls, found.rover if is_same_rover else None)

    assumed = (found.assumed,) if found.assumed else ()
    return Subject(name=name, data=data, make=lambda: found.model, read=read, warnings=assumed)
