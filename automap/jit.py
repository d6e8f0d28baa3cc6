"""How the kernels of sensor model, fusion and gap finder are compiled."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from numba import njit

PACKAGE = Path(__file__).resolve().parent

# divisions by zero give infinity instead of a check at every division. Sums stay in the order in
# which they are written and nothing is fused: what a compiler may choose it chooses anew where it
# compiles a caller beside its callee or finds that one compiled, and close decisions with it
kernel = njit(cache=True, error_model="numpy")
"""Decorator of the numba functions that make up one filter run."""


STAMP = "kernels.stamp"
"""Beside the compiled code: a digest of the sources that it was compiled from."""


def drop_stale(folders: Iterable[Path]) -> None:
    """Remove the index of compiled code beside the sources where any of these has changed.

    Numba compiles a function anew when its own file changes, not when a function or a constant
    that it takes from another file does. What tells a change is each source's name, size and time,
    and not that a source is the newer one: an installed package's files have the time of its build.
    The stamp lies in the first folder.
    """
    folders = list(folders)
    # where nothing may be written nothing was compiled
    with suppress(OSError):
        sources = ((p, p.stat()) for folder in folders for p in sorted(folder.glob("*.py")))
        known = [(p.parent.name, p.name, about.st_size, about.st_mtime_ns) for p, about in sources]
        digest = sha256(repr(known).encode()).hexdigest()
        stamp = folders[0] / "__pycache__" / STAMP
        if stamp.exists() and stamp.read_text(encoding="ascii") == digest:
            return
        for folder in folders:
            for index in (folder / "__pycache__").glob("*.nbi"):
                index.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        # whole or not at all, also beside another process that does the same
        part = stamp.with_name(f"{STAMP}.{os.getpid()}")
        part.write_text(digest, encoding="ascii")
        part.replace(stamp)


KERNEL_FOLDERS = (
    "",
    "effects",
    "fusion",
    "fusion/kernels",
    "fusion/measurements",
    "gap",
    "geolocation",
    "mapping",
)
drop_stale([PACKAGE / folder for folder in KERNEL_FOLDERS])
