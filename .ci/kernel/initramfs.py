"""The first file system of the virtual machine: busybox, an init, and the modules that reach the host."""

import subprocess
from pathlib import Path

MODULES = ("virtio_pci", "9pnet_virtio", "9p", "overlay")
FOLDER_MODE = 0o40755
PROGRAM_MODE = 0o100755
TRAILER = "TRAILER!!!"


def kernel_release(root: Path) -> str:
    """Return the release of the unpacked kernel, e.g. "6.1.0-41-amd64"."""
    (modules,) = (root / "lib/modules").iterdir()
    return modules.name


def index_modules(root: Path) -> None:
    """Write the lists of the kernel's modules and of what they depend on, where they are missing."""
    release = kernel_release(root)
    if not (root / "lib/modules" / release / "modules.dep").is_file():
        # Busybox and the modules are those that Debian signed, unpacked beside this archive.
        subprocess.run(  # noqa: S603
            [root / "bin/busybox", "depmod", "-b", root, release], check=True, stdin=subprocess.DEVNULL
        )


def write_initramfs(root: Path, path: Path) -> None:
    """Write a cpio archive from the unpacked packages in `root` to `path`."""
    release = kernel_release(root)
    files: dict[str, bytes | None] = dict.fromkeys(("bin", "lower", "upper", "new", "proc", "sys", "dev"))
    files["bin/busybox"] = (root / "bin/busybox").read_bytes()
    files["init"] = Path(__file__).with_name("init.sh").read_bytes()
    folder = f"lib/modules/{release}"
    for name in _with_dependencies(root / folder):
        files[f"{folder}/{name}"] = (root / folder / name).read_bytes()
    for name in ("modules.dep", "modules.alias", "modules.symbols", "modules.builtin"):
        files[f"{folder}/{name}"] = (root / folder / name).read_bytes()
    for file in list(files):
        for parent in Path(file).parents:
            if str(parent) != ".":
                files.setdefault(str(parent), None)
    entries = [
        _entry(number, name, content) for number, (name, content) in enumerate(sorted(files.items()), start=1)
    ]
    path.write_bytes(b"".join([*entries, _entry(0, TRAILER, b"")]))


def _with_dependencies(folder: Path) -> list[str]:
    """Return the paths of `MODULES` and of all that they depend on."""
    lines = (folder / "modules.dep").read_text().splitlines()
    table = {path: needs.split() for path, needs in (line.split(":", 1) for line in lines)}
    wanted = {f"{name}.ko" for name in MODULES}
    chosen = [path for path in table if Path(path).name in wanted]
    return sorted({needed for path in chosen for needed in (path, *table[path])})


def _entry(number: int, name: str, content: bytes | None) -> bytes:
    """Return one file, or one folder, in cpio's format "newc"."""
    mode = FOLDER_MODE if content is None else PROGRAM_MODE
    data = content or b""
    fields = (number, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(name) + 1, 0)
    head = b"070701" + b"".join(b"%08X" % field for field in fields) + name.encode() + b"\0"
    return _padded(head) + _padded(data)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
