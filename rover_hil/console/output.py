"""The outputs of a command: both may be full or closed, or lead to a reader that has left."""

import errno
import os
import select
import sys
from contextlib import suppress

STANDARD_ERROR = 2
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


def open_missing_streams() -> None:
    """Replace a stream that the shell has closed (`>&-`, `<&-`) with one that leads nowhere or is empty."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115 - to the end


def tell(sentence: str) -> None:
    """Print a sentence on the standard error, or nowhere if that cannot be written."""
    with suppress(OSError):
        print(sentence, file=sys.stderr)  # noqa: T201 - the one place that reports errors


def can_tell() -> bool:
    """Return whether writing to the standard error would not wait.

    Ctrl-S stops a terminal, and a pipe may be full.
    """
    try:
        return bool(select.select((), (STANDARD_ERROR,), (), 0.0)[1])
    except (OSError, ValueError):
        return False


def end_output() -> str:
    """Write what still waits for the standard output; return a message where that fails, else ""."""
    try:
        sys.stdout.flush()
    except OSError as error:
        return output_problem(error)
    return ""


def output_problem(error: BaseException) -> str:
    """Return the message on an error in writing the standard output; "" for any other error.

    Where the standard output takes one more line, the error is that of another pipe, port or disk.
    """
    if not isinstance(error, OSError) or error.filename is not None or not _output_fails():
        return ""
    if error.errno == errno.EPIPE:
        reason = "nobody reads it any more"
    elif error.errno in FULL:
        reason = f"{error.strerror}; make room there, or send it elsewhere"
    else:
        return ""
    # What waits would be tried again when the interpreter ends.
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return f"cannot write the output: {reason}; the files that were written are complete"


def _output_fails() -> bool:
    try:
        sys.stdout.write("\n")
        sys.stdout.flush()
    except OSError:
        return True
    return False
