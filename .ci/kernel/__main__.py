"""Run the driver suite on the devices of a real kernel, in a virtual machine.

Arguments of `python .ci/kernel` are those of pytest; where none of them names a test, `tests/kernel` is run.
The machine is built once, in the folder that the variable KERNEL_CACHE names.
"""

import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

from camera_module import build_camera_module
from machine import boot
from packages import CannotBuildError, environment, unpack

REPOSITORY = Path(__file__).resolve().parents[2]
DEFAULT_CACHE = REPOSITORY / ".cache" / "kernel"
LIMIT_S = 1800.0
FOLDERS = ("drivers", "controllers", "sim_backends", "rover_hil", "tests")
NUMBA = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
"""The machine's processor is not the host's: code compiled for that one would be compiled anew inside."""


def main() -> int:
    """Build the machine where needed, boot it, and return the exit code of pytest inside."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the machine must not outlive this
    cache = Path(os.environ.get("KERNEL_CACHE", DEFAULT_CACHE)).resolve()
    cache.mkdir(parents=True, exist_ok=True)
    try:
        root = unpack(cache)
    except CannotBuildError as error:
        print(f"test-kernel: skipped: {error}")
        return 0
    build_camera_module(cache, root)
    variables = {**NUMBA, "NUMBA_CACHE_DIR": str(cache / "numba")}
    _compile(variables, cache / "compiled")
    return boot(root, cache / "results", _script(root, variables, sys.argv[1:]), LIMIT_S)


def _compile(variables: dict[str, str], stamp: Path) -> None:
    """Compile on the host what would take minutes inside; the simulators only when they have changed."""
    _run_python("-m", "compileall", "-q", *FOLDERS)
    newest = str(max(path.stat().st_mtime_ns for path in (REPOSITORY / "sim_backends").rglob("*.py")))
    if not stamp.is_file() or stamp.read_text() != newest:
        _run_python(".ci/compile_simulators.py", **variables)
        stamp.write_text(newest)


def _run_python(*arguments: str, **variables: str) -> None:
    # This interpreter, with arguments that are written here.
    subprocess.run(  # noqa: S603
        [sys.executable, *arguments], cwd=REPOSITORY, env={**os.environ, **variables}, check=True
    )


def _script(root: Path, variables: dict[str, str], arguments: list[str]) -> str:
    pytest = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", "--color=no"]
    results = ["--junitxml=/results/junit.xml", "--basetemp=/tmp/pytest"]
    guest = {
        **variables,
        "HOME": "/root",
        "ROVER_HIL_KERNEL": str(root),
        "LD_LIBRARY_PATH": environment(root)["LD_LIBRARY_PATH"],
        "PATH": f"{root}/sbin:{root}/bin:{os.environ['PATH']}",
        "OPENBLAS_NUM_THREADS": "1",
    }
    exports = "".join(f"export {name}={shlex.quote(value)}\n" for name, value in guest.items())
    names_tests = any(Path(REPOSITORY, argument.partition("::")[0]).exists() for argument in arguments)
    command = shlex.join([*pytest, *results, *arguments, *([] if names_tests else ["tests/kernel"])])
    lines = [
        "mkdir -p /lib/modules /sbin",
        f"mount --bind {shlex.quote(str(root / 'lib/modules'))} /lib/modules",
        *(f"ln -sf {shlex.quote(str(root / 'bin/busybox'))} /sbin/{name}" for name in ("modprobe", "rmmod")),
        f"cd {shlex.quote(str(REPOSITORY))}",
        command,
    ]
    return exports + "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
