"""Run the driver suite on the devices of a real kernel, in a virtual machine.

Without arguments two machines run half of `tests/kernel` each, at once. Arguments are those of pytest, in one
machine. The machine is built once, in the folder that the variable KERNEL_CACHE names.
"""

import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

from camera_module import build_camera_module
from initramfs import index_modules
from machine import Machine
from packages import CannotBuildError, environment, unpack

REPOSITORY = Path(__file__).resolve().parents[2]
DEFAULT_CACHE = REPOSITORY / ".cache" / "kernel"
LIMIT_S = 1800.0
FIRST = ("test_can_*.py", "test_camera.py")
"""Tests of the first machine, about half of the time; the second runs all others."""
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
    index_modules(root)
    variables = {**NUMBA, "NUMBA_CACHE_DIR": str(cache / "numba")}
    _compile(variables, cache / "compiled")
    results, arguments = cache / "results", sys.argv[1:]
    first, second = _halves()
    if arguments:
        names_tests = any(Path(REPOSITORY, argument.partition("::")[0]).exists() for argument in arguments)
        script = _script(root, variables, [*arguments, *([] if names_tests else first + second)])
        with Machine(root, results / "1", script, is_shown=True) as machine:
            return machine.exit_code(LIMIT_S)
    with (
        Machine(root, results / "1", _script(root, variables, first), is_shown=True) as one,
        Machine(root, results / "2", _script(root, variables, second), is_shown=False) as other,
    ):
        return max(one.exit_code(LIMIT_S), other.exit_code(LIMIT_S))


def _halves() -> tuple[list[str], list[str]]:
    """Return the test files of the first and of the second machine."""
    tests = REPOSITORY / "tests/kernel"
    first = {path for pattern in FIRST for path in tests.glob(pattern)}
    halves = (first, set(tests.glob("test_*.py")) - first)
    one, other = (sorted(str(path.relative_to(REPOSITORY)) for path in half) for half in halves)
    return one, other


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
    # Only this form of the results has room for what tests note in it.
    results = ["--junitxml=/results/junit.xml", "-ojunit_family=xunit1", "--basetemp=/tmp/pytest"]
    guest = {
        **variables,
        "HOME": "/root",
        "ROVER_HIL_KERNEL": str(root),
        "LD_LIBRARY_PATH": environment(root)["LD_LIBRARY_PATH"],
        "PATH": f"{root}/sbin:{root}/bin:{os.environ['PATH']}",
        "OPENBLAS_NUM_THREADS": "1",
    }
    exports = "".join(f"export {name}={shlex.quote(value)}\n" for name, value in guest.items())
    command = shlex.join([*pytest, *results, *arguments])
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
