"""Compile v4l2loopback, a camera whose frames another program writes: Debian has its source only."""

import shutil
import subprocess
from pathlib import Path

from initramfs import kernel_release
from packages import CannotBuildError, apt_in, run

PACKAGE = "v4l2loopback-dkms"
MODULE = "v4l2loopback.ko"
TOOLS = ("gcc", "ld", "make")
HEADERS_FOLDER = "/usr/src/"


def build_camera_module(cache: Path, root: Path) -> None:
    """Add the module to the unpacked kernel in `root`; tried once for a cache.

    `camera_module.txt` in the cache then holds the reason why it could not be built, or nothing.
    """
    note = cache / "camera_module.txt"
    if note.is_file():
        return
    work = cache / "camera_module"
    try:
        _build(work, root)
        reason = ""
    except CannotBuildError as error:
        reason = str(error)
    except subprocess.CalledProcessError as error:
        lines = (error.stderr or "").strip().splitlines()[-1:] or [str(error)]
        reason = f"v4l2loopback cannot be built: {lines[0]}"
    shutil.rmtree(work, ignore_errors=True)
    note.write_text(reason)


def _build(work: Path, root: Path) -> None:
    missing = [name for name in TOOLS if shutil.which(name) is None]
    if missing:
        raise CannotBuildError(f"v4l2loopback is compiled on the host, and there is no {missing[0]} here")
    release = kernel_release(root)
    kernel_version = release.rsplit("-", 1)[0]
    kbuild = "linux-kbuild-" + ".".join(kernel_version.split(".")[:2])
    headers = f"linux-headers-{release}"
    common = f"linux-headers-{kernel_version}-common"
    shutil.rmtree(work, ignore_errors=True)
    apt = apt_in(work / "apt")
    run([*apt, "update"], work)
    run([*apt, "download", PACKAGE, headers, common, kbuild], work)
    for package in sorted(work.glob("*.deb")):
        run(["dpkg-deb", "-x", str(package), str(work)], work)
    sources = work / HEADERS_FOLDER.strip("/")
    makefile = sources / headers / "Makefile"  # names its common part by an absolute path
    makefile.write_text(makefile.read_text().replace(HEADERS_FOLDER, f"{sources}/"))
    (module,) = sources.glob("v4l2loopback-*")
    run(["make", "-C", str(sources / headers), f"M={module}", "CC=gcc", "modules"], work)
    modules = root / "lib/modules" / release
    (modules / "extra").mkdir(exist_ok=True)
    shutil.copy(module / MODULE, modules / "extra")
    (modules / "modules.dep").unlink(missing_ok=True)  # written anew with the module
