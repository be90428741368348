"""Record what every command prints and writes, and compare a later state of the code with it, bit for bit.

    python -m benchmarks.program.reference_outputs record FOLDER ../shared/data
    python -m benchmarks.program.reference_outputs compare FOLDER ../shared/data

`record` also makes two-process logs of both rovers; `compare` replays every recorded log with the code of
today and runs every other command again. Exit code 1: something differs, and the list names it.
"""

import argparse
import difflib
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from rover_hil.recording.reader import LogReader

MOUNDS = "{data}/trace_drives/mounds"
ROBOTINO_RUNS = "{data}/robotino_2023/one_surface_type/gray_surface"
COMMANDS = {
    "version_help": "--help",
    "run_robotino": "run robotino --virtual --out out",
    "run_el_dorado": "run el-dorado --virtual --out out --duration 8",
    "replay_robotino": "replay {folder}/run_robotino/out/run.mcap --out out",
    "replay_el_dorado": "replay {folder}/run_el_dorado/out/run.mcap --out out",
    "replay_live_robotino": "replay {folder}/live_robotino/out/run.mcap",
    "replay_live_el_dorado": "replay {folder}/live_el_dorado/out/run.mcap",
    "import_robotino": "import robotino " + ROBOTINO_RUNS + "/exp00.csv.gz --out exp00.mcap",
    "identify_slip": "identify slip " + ROBOTINO_RUNS + " --out out.toml",
    "identify_motor_table": "identify motor {data}/robotino_2023/motor_identification --out out.toml",
    "identify_motor_averages": "identify motor {data}/robotino_2021 --out out.toml",
    "scomp": "scomp {folder}/run_el_dorado/out/run.mcap --out out.csv",
    "scomp_online": "scomp {folder}/run_el_dorado/out/run.mcap --online --out out.csv",
    "ftrace": "ftrace "
    + MOUNDS
    + "/frames --rig "
    + MOUNDS
    + "/rig.json --telemetry "
    + MOUNDS
    + "/telemetry.csv --out out.csv",
    "gap_side_slope_1": "gap side-slope {data}/side_slope/blind_1 --out out",
    "gap_side_slope_2": "gap side-slope {data}/side_slope/blind_2 --out out",
    "gap_single_wheel": "gap single-wheel {data}/cmu_single_wheel --out out",
    "gap_motor": "gap robotino-motor {data}/robotino_2023/motor_identification --out out",
    "gap_motor_averages": "gap robotino-motor {data}/robotino_2021 --out out",
    "gap_four_wheel": "gap four-wheel-drive {folder}/run_el_dorado/out/run.mcap --out out",
    "terrain_wheel": "terrain wheel --out out",
    "terrain_traverse": "terrain traverse --out out",
    "terrain_climb": "terrain climb --out out",
    "terrain_papers": "terrain papers --out out",
    "terrain_fit": "terrain fit {data}/cmu_single_wheel --out out",
    "tune": "tune robotino --study s --trials 1 --out out",
    "doctor": "doctor robotino --json",
    "bad_config": "run no_such.toml --virtual",
}
LIVE = {"live_robotino": "robotino", "live_el_dorado": "el-dorado"}
LIVE_DURATION_S = 12
EVERY_RUN_DIFFERS = (
    (re.compile(rb'"\d{8}-\d{6}"'), b"DATE"),
    (re.compile(rb'"seconds": ?[\d.]+'), b"TIME"),
    (re.compile(rb"compiling [^\n]*\n"), b""),
    (re.compile(rb"\d{4}-\d\d-\d\d[ T]\d\d:\d\d(:\d\d)?(\.\d+)?( ?UTC|Z|\+00:00)?"), b"DATE"),
    (re.compile(rb"\b\d+(\.\d+)? ?(s|ms|min) of (processor|wall)"), b"TIME"),
    (re.compile(rb'"(work|late|cycle|wall|duration_wall|elapsed)[a-z_]*": ?[-\d.e+]+'), b"TIME"),
    (re.compile(rb'"(p50|p99|max|mean)_(us|ms)": ?[-\d.e+]+'), b"TIME"),
    (re.compile(rb"took less than [\d.]+ [mu]?s"), b"TIME"),
    (re.compile(rb"image/(png|svg.xml);base64,[A-Za-z0-9+/=]+"), b"PICTURE"),
)


def main() -> None:
    """Record or compare, by the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=("record", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args()
    folder, data = arguments.folder.resolve(), arguments.data.resolve()
    names = [name for name in COMMANDS if not arguments.only or name in arguments.only]
    if arguments.what == "record":
        for name, config in LIVE.items():
            if not arguments.only or name in arguments.only:
                record_live(folder / name, config)
        for name in names:
            run_command(name, folder / name, folder, data)
            print(f"recorded {name}", flush=True)
        return
    different = 0
    for name in names:
        with tempfile.TemporaryDirectory() as scratch:
            now = Path(scratch) / name
            run_command(name, now, folder, data)
            differences = compare(folder / name, now)
        different += bool(differences)
        print(f"{'DIFFERENT' if differences else 'same':10s}{name}", flush=True)
        for line in differences:
            print("    " + line)
    sys.exit(1 if different else 0)


def run_command(name: str, place: Path, folder: Path, data: Path) -> None:
    """Run one command in the folder `place`; keep its exit code and what it prints beside what it writes."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    words = [word.format(folder=folder, data=data) for word in COMMANDS[name].split()]
    done = subprocess.run(program(*words), cwd=place, capture_output=True, check=False, env=environment())
    (place / "exit_code").write_text(str(done.returncode))
    (place / "stdout").write_bytes(done.stdout)
    (place / "stderr").write_bytes(done.stderr)


def record_live(place: Path, config: str) -> None:
    """Record a run over the real protocols: the simulated rover is another process."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    server = subprocess.Popen(
        program("simulate", config), cwd=place, env=environment(), stdout=subprocess.PIPE
    )
    try:
        assert server.stdout is not None
        server.stdout.readline()
        arguments = ("run", config, "--out", "out", "--duration", str(LIVE_DURATION_S))
        subprocess.run(program(*arguments), cwd=place, check=False, env=environment())
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(timeout=120)


def program(*words: str) -> list[str]:
    """Return the command line of `rover-hil`."""
    return [sys.executable, "-c", "from rover_hil.app.program import main; main()", *words]


def environment() -> dict[str, str]:
    """Return the environment of a command: this code, and a terminal of fixed width."""
    return {
        **os.environ,
        "PYTHONPATH": str(Path(__file__).parents[2]),
        "OPENBLAS_NUM_THREADS": "1",
        "COLUMNS": "110",
        "TERM": "dumb",
    }


def compare(before: Path, now: Path) -> list[str]:
    """Return what differs between two folders; empty when nothing does."""
    files = {path.relative_to(root) for root in (before, now) for path in root.rglob("*") if path.is_file()}
    differences = []
    for file in sorted(files):
        paths = before / file, now / file
        if not all(path.exists() for path in paths):
            differences.append(f"{file}: only {'before' if paths[0].exists() else 'now'}")
        elif file.suffix == ".mcap":
            differences += [f"{file}: {topic}" for topic in compare_logs(*paths)]
        elif file.suffix not in (".db", ".journal", ".png"):
            differences += compare_texts(str(file), *(normalised(path.read_bytes()) for path in paths))
    return differences


def compare_logs(before: Path, now: Path) -> list[str]:
    """Return the topics that differ; times that the machine needed do not count."""
    digests = [log_digests(path) for path in (before, now)]
    return [
        topic
        for topic in sorted({*digests[0], *digests[1]})
        if digests[0].get(topic) != digests[1].get(topic)
    ]


def log_digests(path: Path) -> dict[str, str]:
    """Return a digest of every topic of a log, and of its configuration."""
    log = LogReader(path)
    digests = {"config.json": hashlib.sha256(log.config_json)}
    for message in log.messages():
        if message.topic != "/cycle":
            digest = digests.setdefault(message.topic, hashlib.sha256())
            digest.update(message.t_ns.to_bytes(8, "big", signed=True) + message.data)
    return {topic: digest.hexdigest() for topic, digest in digests.items()}


def normalised(text: bytes) -> bytes:
    """Return a text without dates, times that the machine needed, and names of temporary folders."""
    for pattern, name in EVERY_RUN_DIFFERS:
        text = pattern.sub(name, text)
    return re.sub(rb"/[^ \"',)]*/(?=out|exp00|s/)", b"", text)


def compare_texts(name: str, before: bytes, now: bytes) -> list[str]:
    """Return the first lines that differ."""
    if before == now:
        return []
    old, new = (text.decode("utf-8", "replace").splitlines() for text in (before, now))
    changes = [line for line in difflib.unified_diff(old, new, lineterm="", n=0) if line[:1] in "+-"][2:10]
    return [f"{name}: {json.dumps(line[:200])}" for line in changes]


if __name__ == "__main__":
    main()
