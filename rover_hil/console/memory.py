"""Too little memory: commands that cannot load are refused, and what fails later is called by its name."""

import errno
import mmap
import resource
from collections.abc import Callable

from drivers.errors import RoverHilError
from drivers.files import MEGABYTE

LOADED_BYTES = 512 * MEGABYTE
"""No command that reads a configuration can load its libraries in less; most need more than that.
`python -m benchmarks.program.little_memory` prints what they need."""
LIBRARY_BYTES = 256 * MEGABYTE
"""Where less than this is left, a library may not load. The largest, LLVM, needs half of it."""
LINEAR_ALGEBRA_BYTES = 128 * MEGABYTE
"""OpenBLAS takes a buffer of 32 MB at its first call, and one that gets none tries again for ever."""
HIGHER_LIMIT = "use a shell with a higher `ulimit -v`; a run needs about 1000 MB"


class ShortOfMemoryError(RoverHilError, MemoryError):
    """There is too little memory."""


def require_loading_memory() -> None:
    """Check, before libraries are loaded, that they will fit under the limit of this shell.

    Raises:
        ShortOfMemoryError: They will not.
    """
    if is_limited() and not is_free(LOADED_BYTES):
        raise _too_little_to_begin()


def prepare_linear_algebra() -> None:
    """Let numpy and scipy take the buffers of their linear algebra while there is memory, under a limit.

    Raises:
        ShortOfMemoryError: There is too little for them.
    """
    if not is_limited():
        return
    import numpy as np

    _call_once(lambda: np.linalg.inv(np.eye(2)))
    from scipy.linalg.lapack import dpotrf

    _call_once(lambda: dpotrf(np.eye(2)))


def sentence_of(error: BaseException) -> str:
    """Return the message on an error that is due to too little memory; empty for any other.

    Libraries say so in many ways: one that cannot be mapped is an ImportError, a thread that cannot be
    started a RuntimeError. So under a limit any error counts where the next library would not fit.
    """
    if isinstance(error, RoverHilError):
        return ""
    if is_limited() and not is_free(LIBRARY_BYTES):
        return f"too little memory: this shell limits it to {_limit_mb()} MB: {HIGHER_LIMIT}"
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return "too little memory: end other programs, or use less data"
    return ""


def is_limited() -> bool:
    """Return whether the address space of this process is limited."""
    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def is_free(size: int) -> bool:
    """Return whether so many bytes could be had now."""
    try:
        mmap.mmap(-1, size).close()
    except OSError:
        return False
    return True


def _limit_mb() -> int:
    return resource.getrlimit(resource.RLIMIT_AS)[0] // MEGABYTE


def _call_once(call: Callable[[], object]) -> None:
    if not is_free(LINEAR_ALGEBRA_BYTES):
        raise _too_little_to_begin()
    call()


def _too_little_to_begin() -> ShortOfMemoryError:
    return ShortOfMemoryError(
        f"this shell limits the memory to {_limit_mb()} MB, which is too little to begin: {HIGHER_LIMIT}"
    )
