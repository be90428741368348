"""Whether long commands give the same on a cluster as here, also when a worker is killed in the middle.

    python -m benchmarks.tuning.commands_on_a_cluster FOLDER [--kill-after 8]

FOLDER holds the samples `test_bed`, `runs`, `floors` and `wheels` of `rover-hil sample`. Starts a scheduler
and two workers on this machine, runs each command here and on the cluster, one of them once more while a
worker is killed, and compares what they print. Exit code 1 where something differs, or where the command had
ended before the worker was to be killed: then give a shorter time.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from drivers.clock import seconds, stopwatch_ns
from tests.rover_hil.parallel.cluster import running_scheduler, running_worker, wait_for_workers

COMMANDS = {
    "identify motor": ("identify", "motor", "runs/first/run.mcap", "runs/second/run.mcap", "--json"),
    "identify slip": ("identify", "slip", "floors", "--test", "floors_test", "--json"),
    "terrain fit": ("terrain", "fit", "test_bed", "--json"),
    "gap": ("gap", "--config", "my_wheels.toml", "drives", "--json"),
}
PROGRAM = "from rover_hil.app.program import main; main()"


def output(
    folder: Path,
    arguments: tuple[str, ...],
    victim: subprocess.Popen[bytes] | None = None,
    kill_s: float = 0.0,
) -> str:
    """Return what a command prints, and its exit code; kill a process while it runs, after some time."""
    if arguments[0] == "gap":
        arguments = (*arguments, "--out", tempfile.mkdtemp())
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path.cwd())},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        if victim is not None:
            try:
                process.wait(kill_s)
                return "ended before the worker was killed"
            except subprocess.TimeoutExpired:
                victim.kill()
        text, _ = process.communicate()
    lines = [line for line in text.splitlines() if '"seconds"' not in line]
    return "\n".join([*lines, f"exit code {process.returncode}"])


def main() -> int:
    """Print a line for each command; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kill-after", type=float, default=8.0, help="of the last command, s")
    options = parser.parse_args()
    folder = options.folder
    is_same = True
    with running_scheduler() as address, running_worker(address), running_worker(address) as victim:
        wait_for_workers(address, 2)
        for name, arguments in COMMANDS.items():
            texts = {}
            for where in ("here", "cluster"):
                more = () if where == "here" else ("--cluster", address)
                started_ns = stopwatch_ns()
                texts[where] = output(folder, (*arguments, *more))
                print(f"{name}: {where} {seconds(stopwatch_ns() - started_ns):.1f} s", flush=True)
            same = texts["here"] == texts["cluster"]
            is_same &= same
            print(f"{name}: {'same' if same else 'DIFFERENT'}, {len(texts['here'])} characters", flush=True)
        arguments = COMMANDS["identify slip"]
        killed = output(folder, (*arguments, "--cluster", address), victim, options.kill_after)
        same = killed == output(folder, arguments)
        is_same &= same
        difference = f"DIFFERENT: {killed.splitlines()[-1]}"
        print(f"identify slip, one of two workers killed: {'same' if same else difference}", flush=True)
    return 0 if is_same else 1


if __name__ == "__main__":
    sys.exit(main())
