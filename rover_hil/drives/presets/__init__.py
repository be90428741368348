"""Columns of known data sets, by name: `rover-hil import table FILE --columns optiodom_diff`."""

from pathlib import Path

FOLDER = Path(__file__).parent


def presets() -> tuple[str, ...]:
    """Return the names of known data sets."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def columns_file(path: Path) -> Path:
    """Return the file of columns: the file itself, or that of the data set which it names."""
    return FOLDER / f"{path}.toml" if str(path) in presets() and not path.is_file() else path
