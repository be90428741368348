"""Boot the virtual machine, one processor without acceleration, and run a script inside."""

import subprocess
import tempfile
from pathlib import Path
from typing import Self

from initramfs import kernel_release, write_initramfs
from packages import environment

MEMORY_MB = 2048
# Numpy needs that much; what a newer one adds is slower to emulate. The kernel needs random numbers to start.
PROCESSOR = "Nehalem,+rdrand"
# One guest instruction is one nanosecond: the guest's time does not depend on the load of the host.
TIME = ("-icount", "shift=0,sleep=on", "-rtc", "base=utc,clock=vm")
CAN_CARDS = (
    "-object", "can-bus,id=wire",
    "-device", "kvaser_pci,canbus=wire",
    "-device", "kvaser_pci,canbus=wire",
)  # fmt: skip
CONSOLE_COMMAND_LINE = "console=ttyS0 panic=-1 quiet loglevel=4 mitigations=off rdinit=/init net.ifnames=0"


class Machine:
    """A virtual machine that runs a shell script; it is ended with the block that it is used in.

    Args:
        root: The unpacked packages.
        results: A folder that the machine writes to; the console is kept there as `console.log`.
        script: What /bin/sh runs inside; the host's files are there, and what it writes is forgotten.
        is_shown: Whether the console goes to the terminal, too.
    """

    def __init__(self, root: Path, results: Path, script: str, *, is_shown: bool) -> None:
        self._root = root
        self._results = results
        self._script = script
        self._is_shown = is_shown

    def __enter__(self) -> Self:
        results = self._results
        results.mkdir(parents=True, exist_ok=True)
        (results / "exit_code").unlink(missing_ok=True)
        (results / "inside.sh").write_text(self._script)
        write_initramfs(self._root, results / "initramfs")
        self._folder = tempfile.TemporaryDirectory()
        # Every argument was made here.
        self._process = subprocess.Popen(  # noqa: S603
            _command(self._root, results, results / "initramfs", Path(self._folder.name) / "wire"),
            env=environment(self._root),
            stdin=subprocess.DEVNULL,
            stdout=None if self._is_shown else subprocess.DEVNULL,
        )
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()
        (self._results / "initramfs").unlink()

    def exit_code(self, limit_s: float) -> int:
        """Return the exit code of the script when it has ended; after the limit, or without one, it is 1."""
        console = self._results / "console.log"
        try:
            self._process.wait(limit_s)
        except subprocess.TimeoutExpired:
            print(f"the virtual machine has not ended after {limit_s:.0f} s and is stopped")
        if not self._is_shown:
            print(console.read_text("utf-8", "replace"))
        found = self._results / "exit_code"
        if not found.is_file():
            print(f"the virtual machine ended without a result; its console is in {console}")
            return 1
        return int(found.read_text())


def _command(root: Path, results: Path, initramfs: Path, wire: Path) -> list[str | Path]:
    release = kernel_release(root)
    shares = {"host": ("/", ",readonly=on"), "results": (results, "")}
    share_arguments = [
        argument
        for name, (path, more) in shares.items()
        for argument in (
            "-fsdev",
            f"local,id={name},path={path},security_model=none,multidevs=remap{more}",
            "-device",
            f"virtio-9p-pci,fsdev={name},mount_tag={name}",
        )
    ]
    return [
        root / "usr/bin/qemu-system-x86_64",
        *("-L", root / "usr/share/qemu", "-L", root / "usr/share/seabios"),
        *("-machine", "pc", "-accel", "tcg", "-cpu", PROCESSOR, "-smp", "1", "-m", str(MEMORY_MB)),
        *TIME,
        *("-nodefaults", "-no-user-config", "-no-reboot", "-display", "none"),
        *("-chardev", f"stdio,id=console,signal=off,logfile={results / 'console.log'}"),
        *("-serial", "chardev:console"),
        *("-kernel", root / f"boot/vmlinuz-{release}", "-initrd", initramfs),
        *("-append", CONSOLE_COMMAND_LINE),
        *share_arguments,
        *CAN_CARDS,
        # Of a serial line, both ends are in the machine: a UART, and a USB adapter with a chip of FTDI.
        *("-chardev", f"socket,id=uart,path={wire},server=on,wait=off", "-serial", "chardev:uart"),
        *("-chardev", f"socket,id=adapter,path={wire}", "-device", "piix3-usb-uhci,id=usb"),
        *("-device", "usb-serial,chardev=adapter,bus=usb.0"),
    ]
