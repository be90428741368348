"""How every calibration runs: drive, read, fit, decide, write. Each has a folder beside this file.

Nothing drives without an order: only this file asks for the order to move a rover, and passes it on.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Generic, NamedTuple, Protocol, TypeVar

from controllers.control_loop import StepOutput
from drivers.driver import Health
from drivers.errors import ConfigError
from rover_hil.config import Config, Rule, read_config_text, shipped_configs
from rover_hil.config.entry import EntryValue, with_entry
from rover_hil.connect.connections import connected
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import LOG_SUFFIX
from rover_hil.console.steps import show_steps
from rover_hil.drives.formats.described_rover import is_configuration, is_log, load_rover
from rover_hil.pages.add_page import add_page
from rover_hil.pages.atomic_write import check_file, write_file
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render
from rover_hil.ready.room import require_room
from rover_hil.ready.turns import on_firm_floor
from rover_hil.run.checks import ROVER_CHECKS, VIRTUAL_RUN_CHECKS, find_too_fast
from rover_hil.run.drive_order import DriveOrder
from rover_hil.run.drive_permission import permit_drive
from rover_hil.run.driving import require_finished, require_uninterrupted, run_real, run_virtual
from rover_hil.run.executive import End, Operator
from rover_hil.terminal import Terminal
from sim_backends.settings import SimulationSettings

LONGEST_STOP_S = 10.0
"""A drive ends when the rover has been stopped for this long: longer than a device takes to come back."""
Facts = Sequence[tuple[str, str]]
"""Names and values of a result, for the terminal, the page and the comments of its file."""


class Judged(Protocol):
    """A result that knows whether it may be used."""

    @property
    def problem(self) -> str:
        """Why it must not be used; empty where it may."""
        ...


Record = TypeVar("Record")
Result = TypeVar("Result", bound=Judged)


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What a user asks of every calibration.

    Attributes:
        source: A configuration, or a log or a file of columns, which know their rover; empty for the rover of
            the logs that an option names.
        log: Log of an earlier drive, used instead of driving.
        virtual: Drive the simulated rover.
        drive: Drive the real one without a question.
        by_hand: Drive nothing: the user moves the rover.
        enter: Enter the result into the configuration.
        out: File to write; None for the one that the calibration names.
        as_json: Print JSON instead of text.
        force: Replace earlier files.
    """

    source: str
    log: Path | None = None
    virtual: bool = False
    drive: bool = False
    by_hand: bool = False
    enter: bool = False
    out: Path | None = None
    as_json: bool = False
    force: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """A drive that a calibration makes.

    Attributes:
        name: Of the drive, in messages; and of its log, where there are several drives.
        config: The rover with the mission.
        limit_s: Longest time.
        words: What is done, shown before the first cycle.
        status: Returns what is shown of a cycle.
        simulated: Returns the simulation to drive in.
        must_finish: A drive that ends early is of no use.
        needs: Devices that the procedure reads: the rover stops without one, as without those with a role.
    """

    name: str
    config: Config
    limit_s: float
    words: str
    status: Callable[[StepOutput], str]
    simulated: Callable[[SimulationSettings], SimulationSettings] = on_firm_floor
    must_finish: bool = True
    needs: Sequence[str] = ()


class Entry(NamedTuple):
    """A value of the configuration that a result gives: see `with_entry`."""

    section: str
    key: str
    value: EntryValue


class Results(NamedTuple):
    """The files of a calibration: its result, the page with the pictures, the logs of its drives."""

    out: Path | None
    page: Path | None
    logs: Sequence[Path]


class Procedure(ABC, Generic[Record, Result]):
    """A procedure whose result is its page: its drives, its fit and its pictures.

    Attributes:
        logs: Logs of earlier drives that an option of its own has named.
        takes_config: The source is a configuration, or a log; False where it is data only.
        takes_log: The source may be a log instead of a configuration.
        is_connected: Real drives are connected with other programs, for pose fixes.
        checks: Of the configuration, beside that a simulated drive has a simulation.
        good: Grade of a page without a problem.
        page_word: What the page is called.
        room_fix: What to do where the drives need more room.
    """

    logs: Sequence[Path] = ()
    takes_config: ClassVar[bool] = True
    takes_log: ClassVar[bool] = True
    is_connected: ClassVar[bool] = False
    checks: ClassVar[Sequence[Rule]] = ROVER_CHECKS
    good: ClassVar[str] = "plain"
    page_word: ClassVar[str] = "picture"
    room_fix: ClassVar[str] = "choose another place"

    @abstractmethod
    def configure(self, request: Request, config: Config | None) -> Path | None:
        """Check options and configuration; return the file to write, None for none.

        Raises:
            ConfigError: The options contradict the configuration or each other.
        """

    def drives(self, config: Config) -> Sequence[Drive]:
        """Return what is to be driven; nothing where data are read."""
        return ()

    def results(
        self, out: Path | None, drives: Sequence[Drive], *, is_recorded: bool, force: bool
    ) -> Results:
        """Return the files to write, and check that they can be written; logs only where some are recorded.

        A page without the result is of a calibration that was not sure. It does not forbid a repetition, nor
        do the logs beside it.

        Raises:
            ConfigError: A file exists or cannot be made, or `out` has the suffix of a page or a log.
        """
        if out is None:
            return Results(None, None, ())
        page = out.with_suffix(".html")
        logs = [out.with_suffix(LOG_SUFFIX)] if is_recorded else []
        if len(drives) > 1:
            logs = [out.with_name(f"{out.stem}-{drive.name}{LOG_SUFFIX}") for drive in drives]
        if out in (page, *logs):
            raise ConfigError(f"--out {out}: name a file that ends with .toml, or .json for a rig")
        check_file(out, force=force)
        may_replace = force or page.is_file()
        for path in (page, *logs):
            check_file(path, force=may_replace)
        return Results(out, page, logs)

    def record_by_hand(self, config: Config, log: Path) -> None:
        """Record while the user moves the rover.

        Raises:
            ConfigError: Only a drive shows what is calibrated.
        """
        raise ConfigError("--by-hand: this calibration drives the rover itself, leave the option out")

    def begin(self, drive: Drive, *, is_virtual: bool) -> None:
        """Get ready for a drive."""

    def end(self, drive: Drive, log: Path, *, is_virtual: bool) -> None:
        """Note what is known of a drive, by asking or from the simulation."""

    @abstractmethod
    def read(self, logs: Sequence[Path]) -> Record:
        """Return what the logs, or other data, hold."""

    def ask(self, record: Record) -> None:
        """Ask what the record does not show."""

    @abstractmethod
    def fit(self, record: Record) -> Result:
        """Return the result."""

    @abstractmethod
    def title(self, record: Record, result: Result) -> str:
        """Return the heading of the page."""

    @abstractmethod
    def facts(self, record: Record, result: Result) -> Facts:
        """Return the facts for the user."""

    def json(self, record: Record, result: Result, out: Path | None) -> Mapping[str, object]:
        """Return the facts for a program."""
        return {**dict(self.facts(record, result)), "problem": result.problem}

    @abstractmethod
    def figures(self, record: Record, result: Result) -> Sequence[Drawing]:
        """Return the pictures of the page."""

    def entries(self, record: Record, result: Result, out: Path | None) -> Sequence[Entry]:
        """Return where the configuration takes the result."""
        return ()


class FileProcedure(Procedure[Record, Result]):
    """A procedure whose result is a file, beside the page."""

    @abstractmethod
    def write(self, record: Record, result: Result) -> str:
        """Return the text of the file."""


def run(procedure: Procedure[Record, Result], request: Request) -> int:
    """Carry a calibration out; returns the exit code: 1, and no file, if its result is not sure.

    The page with the pictures is written last, also where the result is not sure.

    Raises:
        ConfigError: The configuration or an option cannot be used, or a file exists.
        LogError: A log is damaged, or does not hold what is needed.
    """
    logs = list(procedure.logs)
    if request.log is not None:
        logs = [request.log]
    if not request.source:
        request = replace(request, source=_source_of(logs))
    source = request.source
    if not logs and _is_data(procedure, source):
        logs = [Path(source)]
    _check_options(request, logs)
    config = _load(procedure, request, logs)
    out = procedure.configure(request, config)
    is_recorded = config is not None and not logs
    drives = procedure.drives(config) if config is not None and is_recorded and not request.by_hand else ()
    results = procedure.results(out, drives, is_recorded=is_recorded, force=request.force)
    if config is not None and is_recorded:
        _drive_all(procedure, request, config, drives, results.logs)
        logs = list(results.logs)
    with show_steps("reading"):
        record = procedure.read(logs)
    procedure.ask(record)
    with show_steps("fitting"):
        result = procedure.fit(record)
    facts = procedure.facts(record, result)
    entries = [] if result.problem else procedure.entries(record, result, results.out)
    edited = _edited(source, entries) if request.enter and entries else None
    if results.out is not None and isinstance(procedure, FileProcedure) and not result.problem:
        write_file(results.out, procedure.write(record, result))
    if edited is not None:
        write_file(Path(source), edited)
    if results.page is not None:
        add_page(results.page, lambda: _page(procedure, record, result, facts))
    if request.as_json:
        print_json(procedure.json(record, result, results.out))
    else:
        done = "" if result.problem else f" and entered into {source}" if edited else _next_step(entries)
        _print(procedure, result.problem, facts, results, done)
    return EXIT_NO if result.problem else EXIT_OK


def comments(facts: Facts) -> str:
    """Return facts as comments of a TOML file."""
    return "".join(f"# {name}: {value}\n" for name, value in facts) + "\n"


def _is_data(procedure: Procedure[Record, Result], source: str) -> bool:
    """Return whether the source is what is read, and no configuration."""
    return not procedure.takes_config or (procedure.takes_log and source.endswith(LOG_SUFFIX))


def _source_of(logs: Sequence[Path]) -> str:
    """Return what describes the rover where no configuration is named: the first of the logs.

    Raises:
        ConfigError: There are none.
    """
    if not logs:
        raise ConfigError("name the configuration of the rover that is to drive, or logs of its drives")
    return str(logs[0])


def _load(procedure: Procedure[Record, Result], request: Request, logs: Sequence[Path]) -> Config | None:
    """Return the configuration; None where the source is a log or other data, which is read.

    Raises:
        ConfigError: It cannot be read, or describes a rover, but not its devices, and the rover is to drive.
    """
    source, config = request.source, None
    if not _is_data(procedure, source):
        simulated = VIRTUAL_RUN_CHECKS[-1:] if request.virtual else ()
        config = load_rover(source, (*procedure.checks, *simulated))
        if not logs and not is_configuration(source):
            raise ConfigError(
                f"{source} describes the rover, but not the devices to drive it with: name a configuration, "
                "or logs of its drives by their option"
            )
    if request.enter and (config is None or source in shipped_configs() or is_log(source)):
        raise ConfigError(f"--enter: {source} cannot be edited: name a TOML file of yours")
    return config


def _check_options(request: Request, logs: Sequence[Path]) -> None:
    driving = {"--virtual": request.virtual, "--drive": request.drive, "--by-hand": request.by_hand}
    given = " and ".join(option for option, is_given in driving.items() if is_given)
    if logs and given:
        raise ConfigError(f"{logs[0]} is a log: leave {given} out")
    if request.by_hand and (request.virtual or request.drive):
        raise ConfigError("--by-hand drives nothing: leave --virtual and --drive out")


def _drive_all(
    procedure: Procedure[Record, Result],
    request: Request,
    config: Config,
    drives: Sequence[Drive],
    logs: Sequence[Path],
) -> None:
    """Let the rover drive into the logs, the user move it, or the simulated one drive."""
    if request.by_hand:
        procedure.record_by_hand(config, logs[0])
        return
    require_room(config, [drive.config.mission for drive in drives], procedure.room_fix)
    for conflict in dict.fromkeys(line for drive in drives for line in find_too_fast(drive.config)):
        raise ConfigError(conflict)
    order = permit_drive(request.source, config, virtual=request.virtual, drive=request.drive)
    for drive, log in zip(drives, logs, strict=True):
        procedure.begin(drive, is_virtual=order is None)
        _drive(procedure, drive, log, order)
        procedure.end(drive, log, is_virtual=order is None)


def _drive(procedure: Procedure[Record, Result], drive: Drive, log: Path, order: DriveOrder | None) -> None:
    """Drive once, on firm ground where that is simulated: a user, too, has to choose such a place."""
    roles = drive.config.roles.model_copy(update={"required": (*drive.config.roles.required, *drive.needs)})
    config = drive.config.model_copy(update={"roles": roles})
    with show_steps(drive.words) as step:

        def show(output: StepOutput, healths: Sequence[Health]) -> None:
            step(drive.status(output))

        if order is None:
            simulation = drive.simulated(config.require_simulation())
            virtual = config.model_copy(update={"simulation": simulation})
            result = run_virtual(virtual, log, drive.limit_s, show, longest_stop_s=LONGEST_STOP_S)
        else:
            connection: AbstractContextManager[Operator | None] = (
                connected(config) if procedure.is_connected else nullcontext()
            )
            with connection as operator:
                result = run_real(
                    config,
                    log,
                    drive.limit_s,
                    show,
                    order=order,
                    operator=operator,
                    longest_stop_s=LONGEST_STOP_S,
                )
    if drive.must_finish or result.has_lost_device:
        require_finished(result, drive.name)
    require_uninterrupted(result)
    if result.end is not End.FINISHED:
        Terminal(stderr=True).print(f"the {drive.name} ended early: {result.reason}", soft_wrap=True)


def _print(
    procedure: Procedure[Record, Result], problem: str, facts: Facts, results: Results, done: str
) -> None:
    console = Terminal(soft_wrap=True)
    for name, value in facts:
        console.print(f"{name}: {value}")
    if results.page is not None:
        console.print(f"{procedure.page_word}: {results.page}")
    if results.out is not None and isinstance(procedure, FileProcedure):
        console.print(f"not written: {problem}" if problem else f"written to {results.out}{done}")


def _page(procedure: Procedure[Record, Result], record: Record, result: Result, facts: Facts) -> str:
    return render(
        "pages/facts.html",
        grade="attention" if result.problem else procedure.good,
        title=procedure.title(record, result),
        facts=facts,
        pictures=draw_pictures(procedure.figures(record, result)),
    )


def _edited(source: str, entries: Sequence[Entry]) -> str:
    """Return the text of a configuration with the entries; made before any file is written."""
    text = read_config_text(source)
    for section, key, value in entries:
        text = with_entry(text, section, key, value)
    return text


def _next_step(entries: Sequence[Entry]) -> str:
    if not entries:
        return ""
    if len(entries) > 1:
        return "; --enter enters it into the configuration"
    section, key, value = entries[0]
    return f"; in the configuration: [{section}] {key} = {json.dumps(value, ensure_ascii=False)}"
