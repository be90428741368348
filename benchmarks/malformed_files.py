"""Give malformed input to every command that reads a file: it must do its work or report what is wrong.

Run `python -m benchmarks.malformed_files --random 60`. Each command runs in a process of its own; counted are
tracebacks, more than 1 GB of memory, more than 20 s, other exit codes than 0, 1 and 2, and long messages.
Prints JSON; exit code 1 when there was one.
"""

import argparse
import json
import multiprocessing
import os
import random
import re
import resource
import select
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from benchmarks.datasets.bad_files import Bad, all_cases, arguments_of
from benchmarks.malformed import imports as malformed_imports
from benchmarks.malformed import logs as malformed_logs
from benchmarks.malformed import settings as malformed_settings
from benchmarks.malformed import tables as malformed_tables
from drivers.clock import seconds, stopwatch_ns
from sim_backends.fmu.example.build import build_unit, compiler

LONGEST_S = 20.0
"""Of computing; a machine that does other things too must not fail."""
LONGEST_WAIT_S = 120.0
MOST_BYTES = 1_000_000_000
ADDRESS_BYTES = 6_000_000_000
"""Protects the machine; above what a command may take."""
MOST_LINES = 12
MOST_CHARACTERS = 6000
FORK = multiprocessing.get_context("fork")
KINDS = ("logs", "tables", "settings", "pictures", "paths", "imports")

ROVERS = {"robotino": "board", "el-dorado": "wheels"}
"""Shipped rovers, and the device of each that turns the wheels."""
QUICK_SHARE = 0.035

LOG_COMMANDS = (
    ("replay", "{file}", "--out", "{out}"),
    ("scomp", "{file}", "--out", "{out}.csv"),
    ("identify", "scomp", "{file}", "--out", "{out}.toml"),
    ("identify", "motor", "{file}"),
    ("identify", "slip", "{file}"),
    ("identify", "probe", "{file}", "--out", "{out}.toml"),
    ("gap", "robotino-drive", "{file}", "--out", "{out}"),
    ("gap", "robotino-motor", "{file}", "--out", "{out}"),
    ("gap", "four-wheel-drive", "{file}", "--out", "{out}"),
    ("export", "{file}", "--csv", "--out", "{out}"),
    ("export", "{file}", "--parquet", "--out", "{out}"),
    ("export", "{file}", "--rosbag2", "--out", "{out}"),
    ("compare", "{file}", "{honest}/robotino.mcap", "--out", "{out}.html"),
    ("calibrate", "wheels", "robotino", "--line", "{file}=2.0", "--out", "{out}.toml"),
    ("calibrate", "wheels", "robotino", "--spin", "{file}=3", "--out", "{out}.toml"),
    ("calibrate", "imu", "{file}", "--out", "{out}.toml"),
    ("calibrate", "compass", "el-dorado", "--log", "{file}", "--out", "{out}.toml"),
    ("calibrate", "time", "{file}", "--out", "{out}.toml"),
)
COMMANDS_PER_LOG = 4
"""The first and drawn others."""
PATH_COMMANDS = (
    *LOG_COMMANDS,
    ("import", "robotino", "{file}", "--out", "{out}.mcap"),
    ("run", "{file}", "--virtual", "--out", "{out}"),
    ("doctor", "{file}"),
    ("check", "{file}"),
    ("init", "{out}.toml", "--dbc", "{file}"),
    ("tune", "{file}", "--study", "s", "--out", "{out}"),
    ("replay", "{honest}/robotino.mcap", "--config", "{file}"),
    ("scomp", "{honest}/scomp.csv", "--params", "{file}", "--out", "{out}.csv"),
    ("identify", "scomp", "{honest}/scomp.csv", "--truth", "{file}", "--out", "{out}.toml"),
    ("identify", "probe", "{honest}/robotino.mcap", "--maps", "{file}", "--out", "{out}.toml"),
    ("gap", "side-slope", "{file}", "--out", "{out}"),
    ("gap", "side-slope", "{honest}/slope.csv", "--model", "{file}", "--out", "{out}"),
    ("gap", "check", "{file}:make", "{honest}/machine.csv"),
    ("gap", "check", "{honest}/my_machine.py:make", "{file}"),
    ("ftrace", "{file}", "--rig", "{honest}/rig.json", "--out", "{out}.csv"),
    ("ftrace", "{honest}/frames", "--rig", "{file}", "--out", "{out}.csv"),
    ("ftrace", "{honest}/frames", "--rig", "{honest}/rig.json", "--telemetry", "{file}", "--out", "{out}"),
    ("terrain", "climb", "--rover", "{file}"),
    ("terrain", "climb", "--wheel", "{file}"),
    ("terrain", "climb", "--soil", "{file}"),
    ("terrain", "fit", "{file}"),
    ("terrain", "traverse", "--model", "{file}"),
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A command, and how its malformed file is made.

    Attributes:
        make: Writes the file; returns the command where only the written file names it, else None.
        command: The command, or what is known of it.
    """

    name: str
    make: Callable[[], Sequence[str] | None]
    command: tuple[str, ...]


@dataclass
class Outcome:
    """What a command did."""

    name: str
    command: str
    exit_code: int
    seconds: float
    megabytes: float
    faults: list[str]
    message: str


@dataclass
class Report:
    """All faults, and how much was tried.

    `unfinished` counts analyses of `gap` and `tune` that were ended: they had found the file sound, and take
    minutes on honest data too.
    """

    commands: int = 0
    unfinished: int = 0
    files: dict[str, int] = field(default_factory=dict)
    exit_codes: dict[int, int] = field(default_factory=dict)
    slowest_s: float = 0.0
    most_megabytes: float = 0.0
    faulty: list[Outcome] = field(default_factory=list)


class Suite:
    """Makes the cases in a folder; the same seed makes the same files."""

    def __init__(self, folder: Path, seed: int, rovers: Mapping[str, str] = ROVERS) -> None:
        self._folder = folder
        self._honest = folder / "honest"
        self._seed = seed
        self._rovers = rovers

    def write_honest(self, logs: Path | None) -> None:
        """Write the honest files that commands need besides the malformed one.

        Args:
            logs: Folder that keeps the two honest logs from one time to the next.
        """
        self._honest.mkdir()
        malformed_tables.write_honest(self._honest)
        for name in self._rovers:
            kept = None if logs is None else logs / f"{name}.mcap"
            if kept is None or not kept.exists():
                # In a process of its own: processes forked later must not miss threads of a run.
                writer = FORK.Process(
                    target=malformed_logs.write_base_log, args=(name, kept or self._honest / f"{name}.mcap")
                )
                writer.start()
                writer.join()
            if kept is not None:
                shutil.copy(kept, self._honest / kept.name)
        frames = self._honest / "frames"
        frames.mkdir()
        for number in range(3):
            (frames / f"{number}.png").write_bytes(malformed_logs.png_bomb(16))
        rig = next(kind for kind in malformed_settings.honest_settings() if kind.name == "rig")
        (self._honest / "rig.json").write_text(rig.text)
        if compiler():
            build_unit(self._honest / "axis.fmu")

    def cases(self, kind: str, count: int) -> Iterator[Case]:
        """Yield the cases of a kind, with that many random ones per format."""
        generator = random.Random(f"{self._seed} {kind}")
        makers = {
            "logs": self._logs,
            "tables": self._tables,
            "settings": self._settings,
            "pictures": self._pictures,
            "paths": self._paths,
            "imports": self._imports,
        }
        yield from makers[kind](count, generator)

    def _logs(self, count: int, generator: random.Random) -> Iterator[Case]:
        for name, device in self._rovers.items():
            parts = malformed_logs.read_parts(self._honest / f"{name}.mcap")
            named = [*malformed_logs.named_logs(parts, device)]
            drawn = [
                (f"random_{number}", _later(malformed_logs.random_log, parts, generator.random()))
                for number in range(count)
            ]
            for label, make in (*named, *drawn):
                file = self._folder / f"{name}_{label}.mcap".replace("/", "_").replace("\x1b", "_")
                others = generator.sample(LOG_COMMANDS[1:], COMMANDS_PER_LOG - 1)
                for command in (LOG_COMMANDS[0], *others):
                    yield self._case(f"{name} {label}", file, make, command)

    def _tables(self, count: int, generator: random.Random) -> Iterator[Case]:
        for table in malformed_tables.honest_tables():
            named = [*malformed_tables.named_tables(table)]
            if table.name in ("paths", "plates"):
                named.append(
                    (
                        "many_groups.csv",
                        _later(lambda table, _: malformed_tables.many_groups(table), table, 0),
                    )
                )
            drawn = [
                (f"random_{number}.csv", _later(malformed_tables.random_table, table, generator.random()))
                for number in range(count)
            ]
            for label, make in (*named, *drawn):
                folder = self._folder / f"table_{table.name}_{label}"
                if table.inside and label.endswith(".gz"):
                    continue
                file = folder / (table.inside or label)
                for command in table.commands:
                    yield self._case(f"{table.name} {label}", file, make, command, beside=bool(table.inside))

    def _settings(self, count: int, generator: random.Random) -> Iterator[Case]:
        for kind in malformed_settings.honest_settings():
            drawn = [
                (f"random_{number}", _later(malformed_settings.random_settings, kind, generator.random()))
                for number in range(count)
            ]
            for label, make in (
                ("honest", kind.text.encode),
                *malformed_settings.named_settings(kind),
                *drawn,
            ):
                folder = self._folder / f"settings_{kind.name}_{label}"
                file = folder / f"file{kind.suffix}"
                config = folder / "config.toml"

                def write(kind=kind, file=file, config=config, make=make) -> None:  # type: ignore[no-untyped-def]
                    for name, text in kind.beside.items():
                        (file.parent / name).write_text(text.replace("{name}", file.name))
                    if kind.config:
                        config.write_text(malformed_settings.config_text(kind, file))
                    file.write_bytes(make())

                commands = kind.commands if label == "honest" else [generator.choice(kind.commands)]
                for command in commands:
                    spelled = tuple(word.replace("{config}", str(config)) for word in command)
                    yield self._written(f"{kind.name} {label}", file, write, spelled)

    def _pictures(self, count: int, generator: random.Random) -> Iterator[Case]:
        drawn = [
            (
                f"random_{number}",
                "0.png",
                _later(lambda _, g: malformed_settings.random_picture(g), 0, generator.random()),
            )
            for number in range(count)
        ]
        calibrate = malformed_settings.CALIBRATE
        for label, name, make in (*malformed_settings.malformed_pictures(), *drawn):
            file = self._folder / f"picture_{label}" / name
            for command in (
                ("ftrace", "{folder}", "--rig", "{honest}/rig.json", "--out", "{out}.csv"),
                ("ftrace", "{file}", "--rig", "{honest}/rig.json", "--out", "{out}.csv"),
                (
                    *calibrate[:2],
                    "{folder}",
                    "--ground",
                    "{file}",
                    "--rover",
                    "{honest}/rig.json",
                    *calibrate[7:],
                ),
            ):
                yield self._case(f"picture {label}", file, make, command)

    def _paths(self, _: int, generator: random.Random) -> Iterator[Case]:
        folder = self._folder / "paths"
        folder.mkdir(exist_ok=True)
        for suffix in ("mcap", "csv", "toml", "json", "py"):
            os.mkfifo(folder / f"pipe.{suffix}")
            (folder / f"zero.{suffix}").symlink_to("/dev/zero")
            (folder / f"loop.{suffix}").symlink_to(folder / f"loop.{suffix}")
            (folder / f"folder.{suffix}").mkdir()
            with (folder / f"large.{suffix}").open("wb") as stream:
                stream.truncate(5_000_000_000)
        for name in ("pipe", "zero", "loop", "folder", "large", "n" * 300, "missing"):
            for command in PATH_COMMANDS:
                suffix = generator.choice(("mcap", "csv", "toml", "json", "py"))
                for ending in {_natural_suffix(command), suffix}:
                    path = folder / f"{name}.{ending}"
                    yield self._written(f"path {path.name[:20]}", path, lambda: None, command)

    def _imports(self, count: int, generator: random.Random) -> Iterator[Case]:
        drawn = malformed_imports.mutations(count, generator)
        folders = malformed_imports.bag_folders(count, generator)
        special = [*all_cases(), *malformed_imports.machine_takers()]
        folder = self._folder / "import"
        for label, cases in (("special", special), ("mutated", drawn), ("mutated", folders)):
            for bad in cases:

                def make(bad: Bad = bad) -> Sequence[str]:
                    folder.mkdir()
                    return arguments_of(bad, bad.write(folder), folder)

                yield Case(f"{label} {bad.kind} {bad.name}", make, ("import",))

    def _case(
        self,
        name: str,
        file: Path,
        make: Callable[[], bytes],
        command: Sequence[str],
        *,
        beside: bool = False,
    ) -> Case:
        def write() -> None:
            if beside:
                for name in ("summary.csv", "plates.csv", "wheel.csv"):
                    shutil.copy(self._honest / name, file.parent / name)
            file.write_bytes(make())

        return self._written(name, file, write, command)

    def _written(self, name: str, file: Path, write: Callable[[], object], command: Sequence[str]) -> Case:
        def make() -> None:
            if file.parent != self._folder / "paths":
                file.parent.mkdir(exist_ok=True)
            write()

        words = tuple(
            word.replace("{file}", str(file))
            .replace("{folder}", str(file.parent))
            .replace("{honest}", str(self._honest))
            .replace("{out}", str(self._folder / "out"))
            for word in command
        )
        return Case(name, make, words)


def _natural_suffix(command: Sequence[str]) -> str:
    words = " ".join(command)
    for pattern, suffix in (
        (r"params|model|maps|config|soil|wheel|rover|run \{|doctor|check|tune", "toml"),
        (r"rig \{file", "json"),
        (r"\{file\}:make", "py"),
        (r"import|truth|side-slope|machine|telemetry", "csv"),
    ):
        if re.search(pattern, words):
            return suffix
    return "mcap"


def _later(function: Callable[..., bytes], value: object, seed: float) -> Callable[[], bytes]:
    return lambda: function(value, random.Random(seed))


def run_case(case: Case, folder: Path) -> Outcome:
    """Run a command in a process of its own."""
    command = case.make() or case.command
    errors = folder / "errors.txt"
    start_ns = stopwatch_ns()
    process = os.fork()
    if process == 0:
        _run_child(command, errors, folder)
    status, usage, is_late = _wait(process)
    wall_s = seconds(stopwatch_ns() - start_ns)
    message = errors.read_text("utf-8", "replace")
    exit_code = os.waitstatus_to_exitcode(status)
    megabytes = usage.ru_maxrss * 1024 / 1e6
    faults = []
    if "Traceback (most recent call last)" in message:
        faults.append("traceback")
    if megabytes * 1e6 > MOST_BYTES:
        faults.append("memory")
    spent_s = wall_s if is_late else usage.ru_utime + usage.ru_stime
    is_analysis = case.command[0] in ("gap", "tune") and "check" not in case.command
    if spent_s > LONGEST_S and not is_analysis:
        faults.append("time")
    if not is_late and exit_code not in (0, 1, 2):
        faults.append("exit code")
    if exit_code == 2 and (message.count("\n") > MOST_LINES or len(message) > MOST_CHARACTERS):
        faults.append("long message")
    if re.search(r"\.py:\d+: \w*Warning: ", message):
        faults.append("warning")
    _empty(folder)
    return Outcome(
        case.name,
        " ".join(command),
        exit_code,
        spent_s,
        megabytes,
        faults,
        message[:300] + message[-700:],
    )


def _wait(process: int) -> "tuple[int, resource.struct_rusage, bool]":
    handle = os.pidfd_open(process)
    try:
        is_late = not select.select([handle], [], [], LONGEST_WAIT_S)[0]
    finally:
        os.close(handle)
    if is_late:
        os.kill(process, signal.SIGKILL)
    _, status, usage = os.wait4(process, 0)
    return status, usage, is_late


def _empty(folder: Path) -> None:
    for path in folder.iterdir():
        if path.name not in ("honest", "paths"):
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def _run_child(command: Sequence[str], errors: Path, folder: Path) -> None:
    from rover_hil.app.app import main

    code = 70
    try:
        os.chdir(folder)
        os.setpgid(0, 0)
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_BYTES, ADDRESS_BYTES))
        stream = os.open(errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        nothing = os.open(os.devnull, os.O_RDWR)
        for number, target in enumerate((nothing, nothing, stream)):
            os.dup2(target, number)
        sys.argv = ["rover-hil", *command]
        main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:  # noqa: BLE001 - what a user would see as a traceback
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def load_commands() -> None:
    """Import what the commands import, so that each process need not."""
    import importlib
    import pkgutil

    import rover_hil

    for module in pkgutil.walk_packages(rover_hil.__path__, "rover_hil."):
        if not module.name.endswith("__main__"):
            with suppress(ModuleNotFoundError):  # of an extra that is not installed
                importlib.import_module(module.name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--random", type=int, default=40, help="random files per format")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="*", default=KINDS, choices=KINDS)
    parser.add_argument("--share", type=float, default=1.0, help="run this share of the cases, drawn")
    parser.add_argument("--logs", type=Path, help="keep the honest logs in this folder")
    parser.add_argument("--only", default="", help="only cases with this in name or command")
    parser.add_argument("--quick", action="store_true", help="a small drawn part, for the tests")
    parser.add_argument("--verbose", action="store_true", help="print each outcome on standard error")
    arguments = parser.parse_args()
    if arguments.quick:
        arguments.share, arguments.random = QUICK_SHARE, 2
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    load_commands()
    report = Report()
    draw = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory(prefix="malformed_") as name:
        folder = Path(name)
        rovers = {"robotino": ROVERS["robotino"]} if arguments.quick else ROVERS
        suite = Suite(folder, arguments.seed, rovers)
        suite.write_honest(arguments.logs)
        for kind in arguments.kinds:
            files = set()
            for case in suite.cases(kind, arguments.random):
                is_drawn = draw.random() < arguments.share
                words = " ".join(case.command)
                # A rover of its own has no log here; fits, simulations and large files take long.
                is_left_out = arguments.quick and re.search(
                    "el-dorado|gap|motor|run|tune|bomb|million", f"{case.name} {words}"
                )
                if not is_drawn or is_left_out or arguments.only not in f"{case.name} {words}":
                    continue
                outcome = run_case(case, folder)
                files.add(case.name)
                report.commands += 1
                report.unfinished += outcome.exit_code == -signal.SIGKILL and not outcome.faults
                report.exit_codes[outcome.exit_code] = report.exit_codes.get(outcome.exit_code, 0) + 1
                report.slowest_s = max(report.slowest_s, outcome.seconds)
                report.most_megabytes = max(report.most_megabytes, outcome.megabytes)
                if outcome.faults:
                    report.faulty.append(outcome)
                if arguments.verbose or outcome.faults:
                    print(
                        f"{outcome.exit_code} {outcome.seconds:5.1f} s {outcome.megabytes:5.0f} MB "
                        f"{','.join(outcome.faults) or 'fine'}: {outcome.name}: {outcome.command}",
                        file=sys.stderr,
                        flush=True,
                    )
            report.files[kind] = len(files)
    print(json.dumps(asdict(report), indent=1))
    sys.exit(1 if report.faulty else 0)


if __name__ == "__main__":
    main()
