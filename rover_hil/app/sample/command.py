"""`rover-hil sample`: lists the samples, or writes one."""

from pathlib import Path

from drivers.errors import ConfigError
from rover_hil.app.sample.catalogue import SAMPLES
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.steps import show_steps
from rover_hil.pages.atomic_write import refuse_overwrite, unfinished
from rover_hil.terminal import Terminal


def list_samples() -> int:
    """Print the names of the samples with a line each; returns the exit code."""
    console = Terminal(soft_wrap=True)
    width = max(map(len, SAMPLES))
    for name, sample in SAMPLES.items():
        console.print(f"{name:<{width}}  {sample.line}: {', '.join(sample.paths)}")
    return EXIT_OK


def write_sample(name: str, *, out: Path, force: bool) -> int:
    """Write a sample into the folder `out`; returns the exit code.

    Raises:
        ConfigError: There is no such sample, or a file of it exists or cannot be written.
    """
    sample = SAMPLES.get(name)
    if sample is None:
        raise ConfigError(f"there is no sample '{name}': choose one of {', '.join(SAMPLES)}")
    refuse_overwrite(*(out / path for path in sample.paths), force=force)
    with show_steps(f"making {name}: {sample.line}"), unfinished(out / f"sample {name}") as part:
        part.mkdir()
        sample.make(part)
        for path in sample.paths:
            with unfinished(out / path) as target:
                (part / path).rename(target)
        _remove_empty(part)
    console = Terminal(soft_wrap=True)
    console.print(f"written: {', '.join(str(out / path) for path in sample.paths)}")
    return EXIT_OK


def _remove_empty(folder: Path) -> None:
    for inside in folder.iterdir():
        _remove_empty(inside)
    folder.rmdir()
