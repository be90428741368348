"""Logs and tests with each BLAS kernel that this processor can run, every kernel in processes of its own.

    python -m benchmarks.program.kernels logs
    python -m benchmarks.program.kernels tests [PATH ...]

`logs` makes logs of the shipped rovers with each kernel and replays them with each; the four-wheel rover is
without its camera, whose pictures are computed with BLAS. Exit code 1 where a replay is not identical, or one
with another kernel does not name both. `tests` runs tests with each kernel, all of them where no path is
given; exit code 1 where one fails.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

from benchmarks.safety.faults.processes import CAMERA, CONFIGS
from rover_hil.recording.made_with import BLAS_KERNEL

VARIABLE = "OPENBLAS_CORETYPE"
NEEDED_FLAGS: Mapping[str, frozenset[str]] = {
    "Nehalem": frozenset({"sse4_2"}),
    "Sandybridge": frozenset({"avx"}),
    "Haswell": frozenset({"avx2", "fma"}),
    "SkylakeX": frozenset({"avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl"}),
}
"""What a processor must have for a kernel of OpenBLAS, by the names of Linux."""
COMPARED = ("Nehalem", "Haswell", "SkylakeX")
DURATION_S = "8"
ROVERS = ("robotino", "el-dorado")


def runnable_kernels() -> list[str]:
    """Return the kernels that this processor can run; none where it is not of the family x86."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    flags = next((line.partition(":")[2].split() for line in lines if line.startswith("flags")), [])
    return [kernel for kernel, needed in NEEDED_FLAGS.items() if needed <= set(flags)]


def environment(kernel: str) -> dict[str, str]:
    """Return the environment of a process with a kernel; "" for that of the processor itself."""
    others = {name: value for name, value in os.environ.items() if name != VARIABLE}
    return {**others, VARIABLE: kernel} if kernel else others


def compare_logs(kernels: Sequence[str]) -> int:
    """Print what each log gives with each kernel; return how many replays are not as they must be."""
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for rover, made in product(ROVERS, kernels):
            config, out = Path(folder, f"{rover}.toml"), f"{rover}_{made or 'own'}"
            config.write_text(CAMERA.sub("", (CONFIGS / config.name).read_text()))
            _program(made, folder, "run", config.name, "--virtual", "--duration", DURATION_S, "--out", out)
            for replayed in kernels:
                done = _program(replayed, folder, "replay", f"{out}/run.mcap", "--json")
                compared = json.loads(done)
                was, now = (compared[key][BLAS_KERNEL] for key in ("made_with", "replayed_with"))
                fields = [difference["field"] for difference in compared["differences"]]
                names = (made or was, replayed or now)
                is_right = names == (was, now) and compared["identical"]
                wrong += not is_right
                outcome = (
                    "identical" if compared["identical"] else f"{len(fields)} fields: {', '.join(fields[:4])}"
                )
                print(
                    f"{rover}, made with {was}, replayed with {now}: {outcome}{'' if is_right else ' WRONG'}",
                    flush=True,
                )
    return wrong


def run_tests(kernels: Sequence[str], paths: Sequence[str]) -> int:
    """Run tests with each kernel; return with how many they fail."""
    failed = 0
    for kernel in kernels:
        command = [sys.executable, "-m", "pytest", "-q", *(paths or ("-n", "auto", "--dist", "loadfile"))]
        code = subprocess.run(command, env=environment(kernel), check=False).returncode
        failed += code != 0
        print(f"{VARIABLE} {kernel or 'unset'}: {'passes' if code == 0 else 'FAILS'}", flush=True)
    return failed


def _program(kernel: str, folder: str, *words: str) -> str:
    command = [sys.executable, "-c", "from rover_hil.app.program import main; main()", *words]
    done = subprocess.run(
        command, cwd=folder, env=environment(kernel), stdout=subprocess.PIPE, text=True, check=False
    )
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(words)} ended with {done.returncode}")
    return done.stdout


def main() -> int:
    """Return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("logs", "tests"))
    parser.add_argument("paths", nargs="*")
    arguments = parser.parse_args()
    kernels = ["", *(kernel for kernel in runnable_kernels() if kernel in COMPARED)]
    if arguments.what == "tests":
        return 1 if run_tests(kernels, arguments.paths) else 0
    return 1 if compare_logs(kernels) else 0


if __name__ == "__main__":
    sys.exit(main())
