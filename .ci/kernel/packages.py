"""Unpack Debian's kernel, qemu and busybox into a folder: no root, nothing installed on this machine."""

import os
import shutil
import subprocess
from pathlib import Path

TOOLS = ("qemu-system-x86", "busybox-static", "iproute2")
KERNEL = "linux-image-amd64"
ARCHITECTURE = "amd64"
UNUSED = (
    "usr/share/doc",
    "lib/modules/*/kernel/sound",
    "lib/modules/*/kernel/drivers/gpu",
    "lib/modules/*/kernel/drivers/infiniband",
    "lib/modules/*/kernel/drivers/net/ethernet",
    "lib/modules/*/kernel/drivers/net/wireless",
    "lib/modules/*/kernel/drivers/scsi",
)
"""Half of what the packages hold: removed, for caches of CI are small."""


class CannotBuildError(Exception):
    """The virtual machine cannot be built here, with the reason."""


def unpack(cache: Path) -> Path:
    """Return the folder of the unpacked packages; download them if they are not there yet.

    Raises:
        CannotBuildError: The machine does not run Debian, or the packages cannot be downloaded.
    """
    root = cache / "packages"
    done = cache / "packages.txt"
    if done.is_file():
        return root
    _require_debian()
    shutil.rmtree(root, ignore_errors=True)
    downloads = cache / "downloads"
    apt = apt_in(cache / "apt")
    downloads.mkdir(parents=True, exist_ok=True)
    try:
        run([*apt, "update"], cache)
        names = [*TOOLS, *_missing_libraries(apt), _kernel_of(apt)]
        run([*apt, "download", *dict.fromkeys(names)], downloads)
        for package in sorted(downloads.glob("*.deb")):
            run(["dpkg-deb", "-x", str(package), str(root)], cache)
    except subprocess.CalledProcessError as error:
        reason = error.stderr.strip().splitlines()[-1:] or [str(error)]
        raise CannotBuildError(f"Debian's packages cannot be downloaded: {reason[0]}") from error
    for unused in (path for pattern in UNUSED for path in root.glob(pattern)):
        shutil.rmtree(unused)
    done.write_text("".join(f"{package.name}\n" for package in sorted(downloads.glob("*.deb"))))
    shutil.rmtree(downloads)
    shutil.rmtree(cache / "apt")
    return root


def environment(root: Path) -> dict[str, str]:
    """Return the environment in which an unpacked program finds its libraries."""
    libraries = [str(root / "usr/lib/x86_64-linux-gnu"), str(root / "lib/x86_64-linux-gnu")]
    return {**os.environ, "LD_LIBRARY_PATH": ":".join(libraries)}


def _require_debian() -> None:
    missing = [name for name in ("apt-get", "apt-cache", "dpkg-deb") if shutil.which(name) is None]
    if missing:
        raise CannotBuildError(f"it is built from Debian's packages, and there is no {missing[0]} here")
    architecture = run(["dpkg", "--print-architecture"], Path.cwd()).strip()
    if architecture != ARCHITECTURE:
        raise CannotBuildError(f"it is built for {ARCHITECTURE}, and this machine is {architecture}")


def apt_in(folder: Path) -> list[str]:
    """Return a call of apt-get with package lists of its own: those of the system may be old or missing."""
    (folder / "lists/partial").mkdir(parents=True, exist_ok=True)
    (folder / "archives/partial").mkdir(parents=True, exist_ok=True)
    options = {
        "APT::Sandbox::User": "",
        "Dir::State::Lists": folder / "lists",
        "Dir::Cache": folder,
        "Dir::Cache::Archives": folder / "archives",
    }
    return ["apt-get", "-qq", *(f"-o{name}={value}" for name, value in options.items())]


def _missing_libraries(apt: list[str]) -> list[str]:
    simulated = run([*apt, "--simulate", "--no-install-recommends", "install", *TOOLS], Path.cwd())
    return [line.split()[1] for line in simulated.splitlines() if line.startswith("Inst ")]


def _kernel_of(apt: list[str]) -> str:
    options = [option for option in apt if option.startswith("-o")]
    depends = run(["apt-cache", *options, "depends", KERNEL], Path.cwd())
    found = [line.split()[-1] for line in depends.splitlines() if "linux-image-" in line]
    kernels = [name for name in found if name != KERNEL]
    if not kernels:
        raise CannotBuildError(f"Debian's package {KERNEL} cannot be found")
    return kernels[0]


def run(command: list[str], folder: Path) -> str:
    """Run a command in a folder, which is made, and return what it prints."""
    folder.mkdir(parents=True, exist_ok=True)
    # Every command is a program of the system with arguments that this file made.
    return subprocess.run(  # noqa: S603
        command, cwd=folder, check=True, capture_output=True, text=True
    ).stdout
