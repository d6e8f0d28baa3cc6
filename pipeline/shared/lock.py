"""Keeps two runs from writing into one folder at the same time."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from automap.errors import ConfigError

_NOT_SUPPORTED = (errno.ENOLCK, errno.EOPNOTSUPP, errno.EBADF, errno.EINVAL, errno.ENOSYS)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder for this process; ConfigError when another one holds it.

    The lock is the kernel's and lies on the folder itself, so it ends with the process that
    holds it, however that ends, and leaves no file. A file system without locks is used
    without one.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigError(
                f"{folder}: another automap run is writing there; wait for it to end or choose "
                "another folder with -o"
            ) from None
        except OSError as error:
            if error.errno not in _NOT_SUPPORTED:
                raise
        yield
    finally:
        os.close(handle)
