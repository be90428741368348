"""Compile the example into a functional mock-up unit."""

import shutil
import subprocess
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

from drivers.errors import ConfigError
from sim_backends.fmu.library import fmpy

HERE = Path(__file__).parent
FLAGS = ("-shared", "-fPIC", "-O2", "-std=c11", "-lm")


def compiler() -> str:
    """Return the C compiler of this machine; empty where there is none."""
    return shutil.which("cc") or shutil.which("gcc") or ""


def build_unit(path: Path, *, version: int = 2, code: str = "") -> None:
    """Write the example as an FMU.

    Args:
        path: File to write.
        version: Of the standard, 2 or 3.
        code: C code instead of that of the example.

    Raises:
        ConfigError: There is no compiler, or it fails.
    """
    if not compiler():
        raise ConfigError("there is no C compiler to build the unit: install gcc")
    library = fmpy()
    headers = Path(str(library.__file__)).parent / "c-code"
    platform = library.platform if version == 2 else library.platform_tuple
    with TemporaryDirectory() as name:
        source, built = Path(name) / "axis.c", Path(name) / "axis.so"
        source.write_text(code or (HERE / "axis.c").read_text("utf-8"), "utf-8")
        done = subprocess.run(  # noqa: S603 - the user's own compiler, on our own file
            [compiler(), str(source), "-o", str(built), f"-DFMI_VERSION={version}", f"-I{headers}", *FLAGS],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise ConfigError(f"the C compiler cannot build the unit: {done.stderr.strip()}")
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.write(HERE / f"axis_fmi{version}.xml", "modelDescription.xml")
            archive.write(built, f"binaries/{platform}/axis{library.sharedLibraryExtension}")
