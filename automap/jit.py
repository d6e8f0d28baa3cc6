"""How the kernels of sensor model, fusion and gap finder are compiled."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from numba import njit

PACKAGE = Path(__file__).resolve().parent

# divisions by zero give infinity instead of a check at every division, and sums may be taken
# in any order; NaN and infinity keep their meaning
kernel = njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz", "arcp"})
"""Decorator of the numba functions that make up one filter run."""

kernel_in_order = njit(cache=True, error_model="numpy")
"""The same with sums in the order in which they are written."""


def drop_stale(folders: Iterable[Path]) -> None:
    """Remove the index of compiled code beside the sources that is older than any of them.

    Numba compiles a function anew when its own file changes, not when a function or a constant
    that it takes from another file does.
    """
    folders = list(folders)
    # where nothing may be written nothing was compiled
    with suppress(OSError):
        sources = [p for folder in folders for p in folder.glob("*.py")]
        newest = max((p.stat().st_mtime for p in sources), default=0.0)
        for folder in folders:
            for index in (folder / "__pycache__").glob("*.nbi"):
                if index.stat().st_mtime < newest:
                    index.unlink(missing_ok=True)


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
