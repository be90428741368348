"""A functional mock-up unit, unpacked, and what its model description declares."""

import difflib
import re
import shutil
import weakref
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from types import ModuleType
from typing import Any

from drivers.errors import ConfigError
from drivers.files import UNIT_BYTES, UNIT_BYTES_FREE, UNIT_DESCRIPTION_BYTES, UNIT_FILES, UNIT_PER_BYTE
from sim_backends.fmu.library import fmpy

NUMBERS = ("Real", "Float64")
"""Types of variables that are set and read as floating-point numbers."""
DESCRIPTION = "modelDescription.xml"


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """A scalar variable of a unit.

    Attributes:
        name: Its name.
        reference: Its value reference.
        type: As in the model description.
        unit: Declared; empty for none.
        causality: As in the model description.
        is_settable: It can be set before a simulation.
        is_scalar: It is one number.
        start: Its start value as declared; empty for none.
        low: Least value as declared; empty for none.
        high: Greatest value as declared; empty for none.
    """

    name: str
    reference: int
    type: str
    unit: str
    causality: str
    is_settable: bool
    is_scalar: bool
    start: str
    low: str
    high: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """What a process needs to load a unit.

    Attributes:
        folder: Where it is unpacked.
        library: Its shared library.
        version: Of the standard, 2 or 3.
        identifier: Of the model.
        token: The unit checks it when it is loaded.
    """

    folder: str
    library: str
    version: int
    identifier: str
    token: str


class Folder:
    """A temporary folder, removed when it is closed, at the latest when the program ends."""

    def __init__(self) -> None:
        self.path = Path(mkdtemp(prefix="rover-hil-fmu-"))
        self._remove = weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)

    def close(self) -> None:
        """Remove it."""
        self._remove()


@dataclass(frozen=True, kw_only=True)
class Unit:
    """An unpacked unit; its folder is removed with it.

    Attributes:
        path: The FMU.
        place: What a process needs to load it.
        variables: By name.
        fixed_step_s: Its only step for communication, s; None where it takes others.
        folder: Where it is unpacked.
    """

    path: Path
    place: Place
    variables: Mapping[str, Variable]
    fixed_step_s: float | None
    folder: Folder

    def variable(self, name: str) -> Variable:
        """Return a variable.

        Raises:
            ConfigError: There is none of this name; the message contains the closest.
        """
        if name in self.variables:
            return self.variables[name]
        raise ConfigError(f"{self.path.name} has no variable '{name}'{_closest(name, self.variables)}")

    def close(self) -> None:
        """Remove the folder."""
        self.folder.close()


def open_unit(path: Path) -> Unit:
    """Unpack a unit into a temporary folder and read its description; none of its code is run.

    Raises:
        ConfigError: FMPy is missing, or the file is no unit for co-simulation on this kind of machine.
    """
    library = fmpy()
    if not path.is_file():
        raise ConfigError(f"cannot read the unit {path}: there is no such file")
    folder = Folder()
    try:
        return _unpacked(library, path, folder)
    except BaseException:
        folder.close()
        raise


def _unpacked(library: ModuleType, path: Path, folder: Folder) -> Unit:
    names = _unzip(path, folder.path)
    version = _version(path, folder.path / DESCRIPTION)
    description = _description(path, folder.path)
    if description.coSimulation is None:
        raise ConfigError(f"{path} is a unit for model exchange only: export it for co-simulation")
    interface = description.coSimulation
    step = interface.fixedInternalStepSize
    return Unit(
        path=path,
        place=Place(
            folder=str(folder.path),
            library=_library_file(library, path, folder.path, interface.modelIdentifier, names),
            version=version,
            identifier=str(interface.modelIdentifier),
            token=str(description.guid or description.instantiationToken),
        ),
        variables={one.name: _variable(one) for one in description.modelVariables},
        fixed_step_s=None if step is None else float(step),
        folder=folder,
    )


def _unzip(path: Path, folder: Path) -> list[str]:
    """Unpack a unit and return the names of its files."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            _check_size(path, archive.infolist())
            if DESCRIPTION not in names:
                raise ConfigError(f"{path} is no functional mock-up unit: it has no modelDescription.xml")
            # It leaves out absolute paths and '..'.
            archive.extractall(folder)
    except (zipfile.BadZipFile, OSError, RuntimeError, NotImplementedError) as error:
        raise ConfigError(f"{path} is no functional mock-up unit: {error}") from error
    return names


def _check_size(path: Path, files: Sequence[zipfile.ZipInfo]) -> None:
    """Check the limits of drivers/files.py; no more is unpacked of a file than what it declares here."""
    size = sum(one.file_size for one in files)
    description = sum(one.file_size for one in files if one.filename == DESCRIPTION)
    allowed = min(max(UNIT_BYTES_FREE, UNIT_PER_BYTE * path.stat().st_size), UNIT_BYTES)
    for count, most, what in (
        (size, allowed, "bytes unpacked"),
        (len(files), UNIT_FILES, "files"),
        (description, UNIT_DESCRIPTION_BYTES, f"bytes of {DESCRIPTION}"),
    ):
        if count > most:
            raise ConfigError(
                f"{path}: {count} {what}, {most} are allowed: make it smaller; docs/reference/file_limits.md"
            )


def _description(path: Path, folder: Path) -> Any:
    try:
        return fmpy("model_description").read_model_description(folder, validate=False)
    except Exception as error:
        words = " ".join(str(error).split())
        raise ConfigError(f"the model description of {path} cannot be read: {words}") from error


def _version(path: Path, description: Path) -> int:
    # FMPy reads no other versions, or fails in them.
    stated = re.search(rb"""fmiVersion\s*=\s*["']([^"']*)["']""", description.read_bytes())
    version = "" if stated is None else stated[1].decode("utf-8", "replace")
    major = version.partition(".")[0]
    if major not in {"2", "3"}:
        raise ConfigError(
            f"{path} is a unit of FMI {version or 'without a version'}: export it as FMI 2 or 3"
        )
    return int(major)


def _library_file(
    library: ModuleType, path: Path, folder: Path, identifier: str, names: Iterable[str]
) -> str:
    """Return the shared library for this kind of machine."""
    file = f"{identifier}{library.sharedLibraryExtension}"
    for platform in (library.platform, library.platform_tuple):
        shared = folder / "binaries" / platform / file
        if shared.is_file():
            return str(shared)
    others = sorted(
        {name.split("/")[1] for name in names if name.startswith("binaries/") and name.count("/") > 1}
    )
    raise ConfigError(
        f"{path} has no library for this kind of machine, {library.platform}; it has "
        f"{', '.join(others) or 'none'}: export it for {library.platform}"
    )


def _variable(one: Any) -> Variable:
    declared = one.declaredType
    return Variable(
        name=str(one.name),
        reference=int(one.valueReference),
        type=str(one.type),
        unit=str(one.unit or (declared.unit if declared is not None else None) or ""),
        causality=str(one.causality),
        is_settable=one.variability != "constant"
        and (one.causality in {"parameter", "input"} or one.initial in {"exact", "approx"}),
        is_scalar=not one.dimensions,
        start=str(one.start or ""),
        low=str(one.min or ""),
        high=str(one.max or ""),
    )


def _closest(name: str, names: Iterable[str]) -> str:
    by_small = {one.lower(): one for one in names}
    closest = difflib.get_close_matches(name.lower(), by_small, n=3, cutoff=0.5)
    return f"; the closest is {', '.join(by_small[small] for small in closest[:1])}" if closest else ""
