"""The one place that prints on a terminal: no text of a user or a file is ever markup there.

`rich` reads `[/x]` as the end of a style and `:x:` as an emoji, and a terminal obeys control characters. A
path, a name in a log or the reason of a stop may hold all of these: they are printed as they are,
without the control characters.
"""

from typing import Any, TextIO
from unicodedata import category

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.text import Text

CONTROL = ("Cc", "Cs")
"""Unicode's categories of control characters, and of surrogates: bytes of a name that are not UTF-8."""


class Terminal(Console):
    """A console that prints texts as they are; `Text` and tables keep the styles that the program gives them.

    Args:
        stderr: Print on the standard error.
        soft_wrap: Do not break lines; for sentences and paths that may be copied or read by a script.
        file: Where to print instead.
    """

    def __init__(self, *, stderr: bool = False, soft_wrap: bool = False, file: TextIO | None = None) -> None:
        super().__init__(
            stderr=stderr, soft_wrap=soft_wrap, file=file, highlight=False, markup=False, emoji=False
        )

    def render_str(self, text: str, **options: Any) -> Text:
        """Return a text without control characters, which rich asks for before it prints one."""
        return super().render_str(printable(text), **options)


def printable(text: str) -> str:
    """Return a text with a question mark for each control character and each byte that is not UTF-8."""
    return "".join("?" if category(each) in CONTROL and each not in "\n\t" else each for each in text)


def progress_columns() -> tuple[ProgressColumn, ...]:
    """Return what a bar shows: what is done, how far it is, and the time that is left."""
    return (words_column(), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())


def words_column() -> TextColumn:
    """Return what shows the description of a task, which may name a file."""
    return TextColumn("{task.description}", markup=False)
