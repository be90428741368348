"""`rover-hil sample`: lists the samples, or writes one."""

from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ConfigError
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.options import ForceOption, out_option
from rover_hil.console.steps import show_steps
from rover_hil.pages.atomic_write import refuse_overwrite, unfinished
from rover_hil.sample.catalogue import SAMPLES
from rover_hil.terminal import Terminal


def sample(
    name: Annotated[str | None, typer.Argument(help="The sample; without it, their list.")] = None,
    *,
    out: Annotated[Path, out_option("Folder to write into.")] = Path(),
    force: ForceOption = False,
) -> int:
    """Write small data for the examples, made by the simulators of this program, or list the samples.

    The examples of README and `--help` name the sample that they need.

    Example: `rover-hil sample runs`
    """
    if name is None:
        _list_samples()
    else:
        _write_sample(name, out=out, force=force)
    return EXIT_OK


def _list_samples() -> None:
    console = Terminal(soft_wrap=True)
    width = max(map(len, SAMPLES))
    for name, sample in SAMPLES.items():
        console.print(f"{name:<{width}}  {sample.line}: {', '.join(sample.paths)}")


def _write_sample(name: str, *, out: Path, force: bool) -> None:
    wanted = SAMPLES.get(name)
    if wanted is None:
        raise ConfigError(f"there is no sample '{name}': choose one of {', '.join(SAMPLES)}")
    refuse_overwrite(*(out / path for path in wanted.paths), force=force)
    with show_steps(f"making {name}: {wanted.line}"), unfinished(out / f"sample {name}") as part:
        part.mkdir()
        wanted.make(part)
        for path in wanted.paths:
            with unfinished(out / path) as target:
                (part / path).rename(target)
        _remove_empty(part)
    console = Terminal(soft_wrap=True)
    console.print(f"written: {', '.join(str(out / path) for path in wanted.paths)}")


def _remove_empty(folder: Path) -> None:
    for inside in folder.iterdir():
        _remove_empty(inside)
    folder.rmdir()
