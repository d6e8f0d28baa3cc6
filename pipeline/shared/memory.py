"""Memory that is no longer used goes back to the system at once."""

from __future__ import annotations

import ctypes
import os
import sys
from contextlib import suppress

_MMAP_THRESHOLD = -3
"""``M_MMAP_THRESHOLD`` of glibc's ``mallopt``."""
_BYTES = 1 << 20
"""Arrays from here on lie in pages of their own. Left alone glibc moves this up to 32 MB as arrays
are let go, and keeps what lies below between those still in use: of the fusion of two hours at
100 Hz a tenth of the memory (0.94 GB, 0.84 GB with this)."""


def return_unused_memory() -> None:
    """Have arrays that are let go leave this process; nothing where the system has another
    allocator than glibc's."""
    if sys.platform.startswith("linux"):
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).mallopt(_MMAP_THRESHOLD, _BYTES)
    # Arrow's own pool keeps what was read; it looks here when it is first imported
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
