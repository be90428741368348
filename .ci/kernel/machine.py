"""Boot the virtual machine, one processor without acceleration, and run a script inside."""

import subprocess
import tempfile
from pathlib import Path

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


def boot(root: Path, results: Path, script: str, limit_s: float) -> int:
    """Run a shell script inside and return its exit code; the console goes to the terminal and to a file.

    Args:
        root: The unpacked packages.
        results: A folder that the machine writes to; the console is kept there as `console.log`.
        script: What /bin/sh runs inside; the host's files are there, and what it writes is forgotten.
        limit_s: The machine is ended after this time.
    """
    results.mkdir(parents=True, exist_ok=True)
    exit_code = results / "exit_code"
    exit_code.unlink(missing_ok=True)
    (results / "inside.sh").write_text(script)
    initramfs = results / "initramfs"
    write_initramfs(root, initramfs)
    with (
        tempfile.TemporaryDirectory() as folder,
        # Every argument was made here.
        subprocess.Popen(  # noqa: S603
            _command(root, results, initramfs, Path(folder) / "wire"),
            env=environment(root),
            stdin=subprocess.DEVNULL,
        ) as machine,
    ):
        try:
            machine.wait(limit_s)
        except subprocess.TimeoutExpired:
            print(f"the virtual machine has not ended after {limit_s:.0f} s and is stopped")
        finally:
            machine.kill()
    initramfs.unlink()
    if not exit_code.is_file():
        print(f"the virtual machine ended without a result; its console is in {results / 'console.log'}")
        return 1
    return int(exit_code.read_text())


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
