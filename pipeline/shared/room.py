"""Room for the libraries of linear algebra, which say nothing useful where there is none."""

from __future__ import annotations

import mmap

_ROOM_BYTES = 256 << 20
"""With 220 MB of addresses left NumPy's and SciPy's OpenBLAS load and have their memory; with 200
they end the process, with 130 they ask for ever (measured)."""


def ensure_room() -> None:
    """Raise MemoryError where the addresses that a process may have are limited and used up.

    OpenBLAS asks for its memory as it is loaded; where it gets none it asks for ever, or ends the
    process. So there must be room for it at the start, and it is loaded then. Without a limit
    (``ulimit -v``) the system gives addresses without end, and nothing is done.
    """
    try:
        import resource
    except ImportError:  # not on Windows
        return
    if resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY:
        return
    try:
        mmap.mmap(-1, _ROOM_BYTES, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS).close()
    except OSError as error:
        raise MemoryError from error
    import scipy.linalg  # noqa: F401
