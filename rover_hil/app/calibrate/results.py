"""The files that a calibration writes: constants, a page with the picture, logs of its drives."""

from collections.abc import Sequence
from pathlib import Path

from drivers.errors import ConfigError
from rover_hil.pages.atomic_write import check_file


def check_results(out: Path, logs: Sequence[Path] = (), *, force: bool) -> Path:
    """Check that the results of a calibration can be written; return the path of the page.

    A page without the file of constants is of a calibration that was not sure. It does not forbid a
    repetition, nor do the logs beside it.

    Args:
        out: File of the constants, TOML, or JSON of a rig; the page has its name with `.html`.
        logs: Logs of the drives that the calibration makes.
        force: Replace earlier files.

    Raises:
        ConfigError: A file exists or cannot be made, or `out` has the suffix of a page or a log.
    """
    page = out.with_suffix(".html")
    if out in (page, *logs):
        raise ConfigError(f"--out {out}: name a file that ends with .toml, or .json for a rig")
    check_file(out, force=force)
    may_replace = force or page.is_file()
    for path in (page, *logs):
        check_file(path, force=may_replace)
    return page
