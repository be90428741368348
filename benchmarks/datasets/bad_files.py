"""Import 100 bad files of others: one sentence with file and fix, exit code 2, and nothing half-written.

    python -m benchmarks.datasets.bad_files [--only WORD]

Each sound file of each format is cut, filled with zeros, given wrong delimiters, mixed columns, text, times
that run back, archives that unpack to gigabytes. Prints the cases that miss the bar and the counts; exit code
1 where there was one. Each import is a process of its own, with at most 2 GB of memory and 60 s of a
processor.
"""

import argparse
import gzip
import io
import resource
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import can
import numpy as np
from scipy.io import savemat

from benchmarks.program.can_logs import bus
from drivers.can_wheels.mapping_file import SHIPPED_FOLDER
from tests.rover_hil.flight_logs import Kind, dataflash, ulog
from tests.rover_hil.test_import_rosbag import WHEELS, write_bag

MOST_BYTES = 2_000_000_000
LONGEST_S = 60
"""Of processor time; a machine that does other things too must not fail."""
ROVER = """[rover]
kinematics = "wheels"
wheels = [ { x_m = 0.0, y_m = 0.2, radius_m = 0.1 }, { x_m = 0.0, y_m = -0.2, radius_m = 0.1 } ]
[limits]
wheel_speed_rad_s = 30
wheel_acceleration_rad_s2 = 100
"""
CAR = """[rover]
kinematics = "skid_steer_4"
wheel_radius_m = 0.1
track_m = 0.5
[limits]
wheel_speed_rad_s = 100
wheel_acceleration_rad_s2 = 500
"""
COLUMNS = """time = { column = "t" }
[[wheel]]
position = { column = "l", unit = "rad" }
[[wheel]]
position = { column = "r", unit = "rad" }
"""
FLIGHT = """time = {{ column = "{time}", unit = "us" }}
[[wheel]]
position = {{ column = "WENC.Dist0", unit = "m" }}
[[wheel]]
position = {{ column = "WENC.Dist1", unit = "m" }}
"""
ROWS = 400


@dataclass(frozen=True)
class Bad:
    """One bad file.

    Attributes:
        kind: "table", "can", "flight" or "bag"; "propose", "list" or "robotino" for other commands.
        write: Writes it below a folder, and returns it.
    """

    name: str
    kind: str
    write: Callable[[Path], Path]


def sound_columns() -> dict[str, np.ndarray]:
    """Return a sound drive."""
    t_s = 0.05 * np.arange(ROWS)
    return {"t": t_s, "l": 5.0 * t_s, "r": 5.5 * t_s}


def lines() -> list[str]:
    """Return it as lines of text."""
    rows = zip(*(column.tolist() for column in sound_columns().values()), strict=True)
    return ["t,l,r", *(",".join(map(repr, row)) for row in rows)]


def text_case(name: str, change: Callable[[list[str]], list[str]], suffix: str = ".csv") -> Bad:
    """Return a table as text with changed lines."""

    def write(folder: Path) -> Path:
        path = folder / f"drive{suffix}"
        raw = ("\n".join(change(lines())) + "\n").encode()
        path.write_bytes(gzip.compress(raw) if suffix.endswith(".gz") else raw)
        return path

    return Bad(f"text: {name}", "table", write)


def raw_case(name: str, kind: str, suffix: str, raw: Callable[[], bytes] | bytes) -> Bad:
    """Return a file with given bytes."""

    def write(folder: Path) -> Path:
        path = folder / f"drive{suffix}"
        path.write_bytes(raw if isinstance(raw, bytes) else raw())
        return path

    return Bad(f"{suffix}: {name}", kind, write)


def cell(row: int, column: int, text: str) -> Callable[[list[str]], list[str]]:
    """Return what replaces a cell."""

    def change(found: list[str]) -> list[str]:
        cells = found[row].split(",")
        cells[column] = text
        found[row] = ",".join(cells)
        return found

    return change


def text_cases() -> Iterator[Bad]:
    """Yield bad tables of text."""
    changes: dict[str, Callable[[list[str]], list[str]]] = {
        "empty": lambda _: [],
        "a header only": lambda found: found[:1],
        "without a header": lambda found: found[1:],
        "another delimiter": lambda found: [line.replace(",", "|") for line in found],
        "spaces for commas": lambda found: [line.replace(",", " ") for line in found],
        "decimal commas": lambda found: [line.replace(",", ";").replace(".", ",") for line in found],
        "two delimiters": lambda found: [found[0], *(line.replace(",", ";", 1) for line in found[1:])],
        "other names": lambda found: ["time,left,right", *found[1:]],
        "a name twice": lambda found: ["t,l,l", *found[1:]],
        "text in a wheel": cell(200, 1, "abc"),
        "text in the time": cell(200, 0, "12:04:11"),
        "an empty time": cell(200, 0, ""),
        "a time that is not finite": cell(200, 0, "nan"),
        "time that runs back": lambda found: [found[0], *found[200:], *found[1:200]],
        "times in the wrong order": lambda found: [found[0], *reversed(found[1:])],
        "times of a year": cell(400, 0, "31536000"),
        "a wheel that jumps in all rows": lambda found: [
            found[0],
            *(f"{line.split(',')[0]},{place % 2 * 1e6},0" for place, line in enumerate(found[1:])),
        ],
        "wheels without numbers": lambda found: [
            found[0],
            *(line.split(",")[0] + ",," for line in found[1:]),
        ],
        "decimal commas in a row": cell(200, 1, "49,75"),
        "long cells": cell(3, 1, "9" * 500_000),
        "a html page": lambda _: ["<!DOCTYPE html><html><body>404 not found</body></html>"],
        "json": lambda _: ['{"t": [0, 1], "l": [0, 1], "r": [0, 1]}'],
        "huge numbers": lambda found: [line.replace("5", "5e300") for line in found],
    }
    for name, change in changes.items():
        yield text_case(name, change)
    for name in ("another delimiter", "text in a wheel", "time that runs back", "an empty time"):
        yield text_case(f"{name}, packed", changes[name], ".csv.gz")
    raw = "\n".join(lines()).encode()
    yield raw_case("utf-16", "table", ".csv", lambda: "\n".join(lines()).encode("utf-16"))
    yield raw_case("zeros", "table", ".csv", lambda: bytes(1000))
    yield raw_case("random", "table", ".csv", lambda: np.random.default_rng(1).bytes(5000))
    yield raw_case("not packed", "table", ".csv.gz", lambda: raw)
    yield raw_case("cut archive", "table", ".csv.gz", lambda: gzip.compress(raw)[:-400])
    yield raw_case("damaged archive", "table", ".csv.gz", lambda: damaged(gzip.compress(raw), 3))
    yield raw_case("archive of zeros", "table", ".csv.gz", lambda: gzip.compress(bytes(300_000_000)))
    yield Bad("2 GB of zeros", "table", partial(sparse, name="drive.csv"))


def damaged(raw: bytes, seed: int, share: float = 0.01) -> bytes:
    """Return bytes of which some are others."""
    rng = np.random.default_rng(seed)
    changed = bytearray(raw)
    for place in rng.integers(0, len(changed), max(3, int(share * len(changed)))):
        changed[place] = rng.integers(0, 256)
    return bytes(changed)


def sparse(folder: Path, name: str) -> Path:
    """Write 2 GB of zeros that take no room."""
    with (folder / name).open("wb") as file:
        file.truncate(2_000_000_000)
    return folder / name


def array_cases() -> Iterator[Bad]:
    """Yield bad arrays."""
    matlab, plain = io.BytesIO(), io.BytesIO()
    savemat(matlab, sound_columns())
    np.save(plain, np.column_stack(list(sound_columns().values())))
    sound = {".npz": packed(sound_columns()), ".mat": matlab.getvalue(), ".npy": plain.getvalue()}
    for suffix, raw in sound.items():
        yield raw_case("empty", "table", suffix, lambda: b"")
        yield raw_case("cut", "table", suffix, raw[: len(raw) // 2])
        yield raw_case("text", "table", suffix, lambda: b"t,l,r\n0,0,0\n")
        yield raw_case("zeros", "table", suffix, lambda: bytes(4096))
        # The first 124 bytes of a MATLAB file are a text for people.
        head = 124 if suffix == ".mat" else 0
        spoiled = raw[:head] + damaged(raw[head : head + 60], 5, 0.5) + raw[head + 60 :]
        yield raw_case("damaged head", "table", suffix, spoiled)
        yield Bad(
            f"{suffix}: 2 GB of zeros",
            "table",
            partial(sparse, name=f"drive{suffix}"),
        )
    yield raw_case(
        "columns of other lengths",
        "table",
        ".npz",
        lambda: packed({"t": np.arange(4.0), "l": np.arange(3.0), "r": np.arange(4.0)}),
    )
    yield raw_case("objects", "table", ".npz", lambda: packed({"t": np.array([{}, 1], object)}))
    yield raw_case("an archive that unpacks to gigabytes", "table", ".npz", bomb)
    yield raw_case("text", "table", ".parquet", lambda: b"PAR1 no table PAR1")


def packed(columns: dict[str, np.ndarray]) -> bytes:
    """Return an .npz file."""
    buffer = io.BytesIO()
    np.savez(buffer, **columns)  # type: ignore[arg-type]
    return buffer.getvalue()


def bomb() -> bytes:
    """Return an .npz file with a column of a gigabyte of zeros."""
    buffer = io.BytesIO()
    with (
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("t.npy", "w", force_zip64=True) as file,
    ):
        for _ in range(64):
            file.write(bytes(2**24))
    return buffer.getvalue()


def bus_log(suffix: str) -> bytes:
    """Return a sound log of a CAN bus."""
    with TemporaryDirectory() as name:
        path = Path(name) / f"bus{suffix}"
        with can.Logger(path) as logger:
            for message in bus(2.0):
                logger.on_message_received(message)
        return path.read_bytes()


def can_cases() -> Iterator[Bad]:
    """Yield bad logs of a CAN bus."""
    for suffix in (".log", ".asc", ".blf", ".trc"):
        raw = gzip.compress(bus_log(suffix))
        yield raw_case("empty", "can", suffix, lambda: b"")
        yield raw_case("zeros", "can", suffix, lambda: bytes(5000))
        yield raw_case("of a table", "can", suffix, lambda: "\n".join(lines()).encode())
        yield raw_case("packed twice", "can", f"{suffix}.gz", gzip.compress(raw))
        yield raw_case("cut archive", "can", f"{suffix}.gz", raw[:-3000])
        yield Bad(f"{suffix}: 2 GB of zeros", "can", partial(sparse, name=f"drive{suffix}"))
    yield raw_case("another ending", "can", ".pcap", lambda: bytes(100))
    yield raw_case(
        "other identifiers",
        "can",
        ".log",
        lambda: b"".join(b"(%d.0) can0 7FF#00\n" % second for second in range(200)),
    )


def flight_cases() -> Iterator[Bad]:
    """Yield bad logs of autopilots."""
    kind = Kind("WENC", (("Q", "TimeUS"), ("f", "Dist0"), ("f", "Dist1")))
    px4 = Kind("WENC", (("uint64_t", "timestamp"), ("float", "Dist0"), ("float", "Dist1")))
    for suffix, make in ((".bin", partial(dataflash, (kind,))), (".ulg", partial(ulog, (px4,)))):
        yield raw_case("empty", "flight", suffix, lambda: b"")
        yield raw_case("without a message", "flight", suffix, make([]))
        yield raw_case("zeros", "flight", suffix, lambda: bytes(5000))
        yield raw_case("zeros behind the head", "flight", suffix, make([])[:40] + bytes(3_000_000))
        yield raw_case(
            "a jump of the wheel in all messages",
            "flight",
            suffix,
            make([(0, (1000 * n, 1e6 * (n % 2), 0.0)) for n in range(400)]),
        )
        yield Bad(
            f"{suffix}: 2 GB of zeros",
            "flight",
            partial(sparse, name=f"drive{suffix}"),
        )


def bag_cases() -> Iterator[Bad]:
    """Yield bad bags."""
    for share in (0.0, 0.2, 0.95):

        def cut(folder: Path, share: float = share) -> Path:
            path = write_bag(folder / "whole.bag")
            raw = path.read_bytes()
            path.unlink()
            bag = folder / "drive.bag"
            bag.write_bytes(raw[: int(share * len(raw))])
            return bag

        yield Bad(f"bag cut at {share:g}", "bag", cut)
    yield raw_case("text", "bag", ".bag", lambda: b"#ROSBAG V2.0\nno bag\n")
    yield Bad("bag: 2 GB of zeros", "bag", partial(sparse, name="drive.bag"))


def all_cases() -> list[Bad]:
    """Return the 100 cases."""
    return [*text_cases(), *array_cases(), *can_cases(), *flight_cases(), *bag_cases()]


def arguments_of(bad: Bad, file: Path, folder: Path) -> list[str]:
    """Return the command that imports a file."""
    rover, out = folder / "rover.toml", str(folder / "out.mcap")
    if bad.kind == "robotino":
        return ["import", "robotino", str(file), "--out", out]
    if bad.kind == "propose":
        return ["import", "table", str(file), "--propose", str(folder / "proposed.toml")]
    if bad.kind == "list":
        return ["import", "can", str(file), "--list"]
    if bad.kind == "can":
        rover.write_text(CAR, "utf-8")
        mapping = str(SHIPPED_FOLDER / "odrive_0_6.toml")
        return ["import", "can", str(file), "--config", str(rover), "--map", mapping, "--out", out]
    if bad.kind == "bag":
        (folder / "topics.toml").write_text(WHEELS, "utf-8")
        return ["import", "rosbag", str(file), "--topics", str(folder / "topics.toml"), "--out", out]
    time = "timestamp" if file.suffix == ".ulg" else "TimeUS"
    columns = FLIGHT.format(time=time) if bad.kind == "flight" else COLUMNS
    if file.suffix == ".npy":
        columns = columns.replace('"t"', "1").replace('"l"', "2").replace('"r"', "3")
    (folder / "columns.toml").write_text(columns + ROVER, "utf-8")
    return ["import", "table", str(file), "--columns", str(folder / "columns.toml"), "--out", out]


def miss_of(bad: Bad) -> str:
    """Import a bad file; return what missed the bar, "" for nothing."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        file = bad.write(folder)
        command = [str(Path(sys.executable).with_name("rover-hil")), *arguments_of(bad, file, folder)]
        before = {path.name for path in folder.iterdir()}

        def limit() -> None:
            resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES))
            resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_S, LONGEST_S))

        done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=limit)
        error = [line for line in done.stderr.splitlines() if line.startswith("rover-hil: ")]
        written = {path.name for path in folder.iterdir()} - before
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
    if done.returncode != 2:
        return f"exit code {done.returncode}: {(done.stderr or done.stdout).strip()[-200:]}"
    if written:
        return f"written: {', '.join(written)}"
    if len(error) != 1 or "Traceback" in done.stderr:
        return f"no single sentence: {done.stderr[-300:]}"
    if file.name.split(".")[0] not in error[0] or ":" not in error[0].removeprefix("rover-hil: "):
        return f"without file or fix: {error[0]}"
    return ""


def main() -> int:
    """Run all; returns 1 where one missed the bar."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", default="")
    only = parser.parse_args().only
    cases = [bad for bad in all_cases() if only in bad.name]
    missed = 0
    for bad in cases:
        miss = miss_of(bad)
        if miss:
            missed += 1
            print(f"{bad.name}: {miss}", flush=True)
    print(f"{len(cases)} bad files, {missed} missed the bar")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
