"""Memory that was freed goes back to the system."""

from __future__ import annotations

import ctypes
import sys

_MMAP_THRESHOLD = -3
"""``M_MMAP_THRESHOLD`` of glibc's malloc.h."""
_MAPPED_BYTES = 1 << 18
"""Chosen: what a section of a long drive leaves of its nodes are columns from 0.6 MB on."""


def give_freed_back() -> None:
    """Have the C library map arrays from a quarter of a megabyte on, each by itself.

    Of its own accord glibc keeps up to 32 MB of every freed array in its heap, between others: of a
    long drive that is a third of all. Other C libraries have no such call, and nothing happens.
    """
    try:
        ctypes.CDLL(None).mallopt(_MMAP_THRESHOLD, _MAPPED_BYTES)
    except (AttributeError, OSError, TypeError):
        return


def trim() -> None:
    """Give back what the C library and Arrow keep of what was freed: of ten hours, after their
    readings were written, a quarter of a gigabyte. Other C libraries have no such call."""
    if "pyarrow" in sys.modules:
        sys.modules["pyarrow"].default_memory_pool().release_unused()
    try:
        ctypes.CDLL(None).malloc_trim(0)
    except (AttributeError, OSError, TypeError):
        return
