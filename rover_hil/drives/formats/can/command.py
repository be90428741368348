"""`rover-hil import can`: logs of a CAN bus become logs of a rover, or are listed."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from cantools.database.can import Database

from drivers.can_wheels.mapping_file import load_mapping, read_dbc
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.errors import ConfigError
from rover_hil.config import load_config
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ForceOption, JsonOption, out_option
from rover_hil.console.steps import show_steps
from rover_hil.drives.files.can_frames import read_can_log
from rover_hil.drives.formats.can.listing import ListedIdentifier, absence_of, list_frames, motion_kinds
from rover_hil.drives.formats.can.places import read_places
from rover_hil.drives.formats.can.rover import rover_of_log
from rover_hil.drives.formats.can.to_log import write_can_as_log
from rover_hil.drives.formats.drive import Contents
from rover_hil.drives.formats.files import WriteDrive, import_files
from rover_hil.drives.formats.limits import EstimateOption, LimitSettings, MemoryOption, TimeOption
from rover_hil.drives.formats.reading_process import Report, read_in_child
from rover_hil.terminal import Terminal


@dataclass(frozen=True, slots=True, kw_only=True)
class _Listing:
    """What is in a log of a CAN bus; the counts as in `CanFrames`."""

    path: Path
    frames: int
    duration_s: float
    longer: int
    left_out: int
    unread: int
    listed: Sequence[ListedIdentifier]
    has_dbc: bool


def import_can_logs(
    logs: Annotated[
        list[Path],
        typer.Argument(
            help="Logs of a CAN bus, one per drive: .log of candump, .asc, .blf, .trc, .csv, .mf4."
        ),
    ],
    *,
    config_name: Annotated[
        str | None,
        typer.Option(
            "--config", help="Configuration of the rover; with --map its [rover] and [limits] are enough."
        ),
    ] = None,
    mapping: Annotated[
        Path | None,
        typer.Option("--map", help="Mapping of the wheels: which signal is what."),
    ] = None,
    places_path: Annotated[
        Path | None,
        typer.Option("--places", help="TOML file: which signals or tables are ground truth and positions."),
    ] = None,
    dbc: Annotated[
        list[Path] | None,
        typer.Option(help="With --list or --places: a DBC file; may be given several times."),
    ] = None,
    channel: Annotated[str | None, typer.Option(help="The bus to use, where a log holds several.")] = None,
    list_only: Annotated[
        bool, typer.Option("--list", help="Only print identifiers, rates and decoded signals.")
    ] = False,
    out: Annotated[
        Path | None, out_option("The log to write; for several logs the folder of theirs.")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    most_memory_gb: MemoryOption = None,
    most_minutes: TimeOption = None,
    no_estimate: EstimateOption = False,
) -> int:
    """Turn logs of a CAN bus into logs of a rover; the drivers decode its frames, and replay bit for bit.

    Example: `rover-hil import can drive.log --config el-dorado --out drive.mcap`

    Data: `rover-hil sample can` writes such a log; for yours, docs/how-to/import_a_can_log.md shows mapping
    and DBC file.
    """
    limits = LimitSettings(most_memory_gb, most_minutes)
    if list_only:
        return _list_logs(logs, config_name, mapping, dbc or (), channel, limits, as_json=as_json)
    if config_name is None:
        raise ConfigError("--config is missing: name the configuration of the rover, or use --list")
    if out is None:
        raise ConfigError("--out is missing: name the log to write, or use --list")

    def make_write() -> WriteDrive:
        config = rover_of_log(config_name, mapping)
        places = None if places_path is None else read_places(places_path)
        dbc_files = (*(dbc or ()), *_dbc_files(config_name, mapping))

        def write(file: Path, part: Path) -> Iterator[Contents]:
            return write_can_as_log(
                read_can_log(file, channel=channel),
                config,
                part,
                places=places,
                dbc_files=dbc_files,
                with_estimate=not no_estimate,
            )

        return write

    import_files(logs, out, make_write, limits=limits, what="frames", force=force, as_json=as_json)
    return EXIT_OK


def _list_logs(
    files: Sequence[Path],
    config_name: str | None,
    mapping: Path | None,
    dbc: Sequence[Path],
    channel: str | None,
    limits: LimitSettings,
    *,
    as_json: bool,
) -> int:
    """Print what is in logs of a CAN bus; returns the exit code."""

    def read_databases() -> list[Database]:
        return [read_dbc(path) for path in dict.fromkeys((*dbc, *_dbc_files(config_name, mapping)))]

    listings = [_listing(file, read_databases, channel, limits) for file in files]
    if as_json:
        print_json([_record(listing) for listing in listings])
        return EXIT_OK
    for listing in listings:
        _print(listing)
    return EXIT_OK


def _listing(
    file: Path, read_databases: Callable[[], list[Database]], channel: str | None, limits: LimitSettings
) -> _Listing:
    """Return what is in a log of a CAN bus, which a child process reads."""

    def work(report: Report[str]) -> _Listing:
        databases = read_databases()
        report("DBC files are read")
        frames = read_can_log(
            file, channel=channel, on_frames=lambda count: report(f"{count} frames are read")
        )
        return _Listing(
            path=frames.path,
            frames=len(frames),
            duration_s=float(frames.t_s[-1] - frames.t_s[0]),
            longer=frames.longer,
            left_out=frames.left_out,
            unread=frames.unread,
            listed=list_frames(frames, databases),
            has_dbc=bool(databases),
        )

    return read_in_child(file, limits.of(file), work, show_steps(f"reading {file.name}"))


def _dbc_files(config_name: str | None, mapping: Path | None) -> Iterator[Path]:
    names = [] if mapping is None else [str(mapping)]
    if config_name is not None and mapping is None:
        devices = load_config(config_name).devices.values()
        names = [device.mapping for device in devices if isinstance(device, CanWheelsSettings)]
    for name in names:
        yield from load_mapping(name).dbc_files


def _record(listing: _Listing) -> dict[str, object]:
    kinds = motion_kinds(listing.listed)
    return {
        "log": str(listing.path),
        "frames": listing.frames,
        "duration_s": listing.duration_s,
        "longer": listing.longer,
        "left_out": listing.left_out,
        "unread": listing.unread,
        "motion": sorted(kinds),
        "missing": absence_of(kinds),
        "identifiers": listing.listed,
    }


def _print(listing: _Listing) -> None:
    console = Terminal(soft_wrap=True)
    for entry in listing.listed:
        names = ", ".join(dict.fromkeys(signal.message for signal in entry.signals))
        rate = (
            ""
            if entry.rate_hz is None
            else f", {entry.rate_hz:.4g} /s, longest gap {entry.longest_gap_s:.3g} s"
        )
        console.print(f"{entry.identifier}  {entry.frames} frames{rate}  {names}".rstrip())
        for signal in entry.signals:
            if signal.count:
                kind = f"  {signal.kind}" if signal.kind else ""
                span = f"{signal.least:.6g} to {signal.greatest:.6g} {signal.unit}".rstrip()
                console.print(f"    {signal.signal}: {span}{kind}")
                if signal.odd:
                    console.print(f"        odd: {signal.odd}")
    console.print(
        f"{listing.path}: {listing.frames} frames of {len(listing.listed)} identifiers "
        f"in {listing.duration_s:.3f} s"
    )
    if listing.longer:
        console.print(f"{listing.longer} CAN FD frames have more than 8 data bytes, and are left out")
    if listing.left_out:
        console.print(f"{listing.left_out} frames have another length than they state, and are left out")
    if listing.unread:
        console.print(f"{listing.unread} lines hold no frame")
    if not listing.has_dbc:
        console.print("no DBC file: name one with --dbc to see signals")
    elif missing := absence_of(motion_kinds(listing.listed)):
        console.print(f"{missing}, by names and units in the DBC file")
