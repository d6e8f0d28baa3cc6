"""The existence of signs, left as it was where a merge moved it by nothing that counts.

Each drive moves the rates that the existence of all signs comes from by a trifle: without this it
would write the whole map anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from automap.records import FloatArray
from pipeline.merge.cell_files import write_columns
from pipeline.merge.cell_steps import Homes

BELIEF = "belief.npz"
KEPT_LEVEL = 0.01
"""What differs by less than this part of its standard deviation, or of itself where it is one, is
left as it was: a weight that is wrong by a hundredth moves no place by a hundredth of its sigma,
and all cells stay."""


def kept_belief(folder: Path, homes: Homes, belief: FloatArray, least: float) -> FloatArray:
    """The existence [m] of the signs of ``homes``: of a cell that is placed as before what it was,
    where that of each of its signs is the same but for ``KEPT_LEVEL`` of the standard deviation of
    a yes or no of this probability, and none steps over the ``least`` one of a sign on the map: the
    same signs are on it as from nothing. It is compared with what was computed anew at last, so
    that small steps do not add up."""
    before, kept = _read(folder / BELIEF), belief.copy()
    for digest, lo, hi in zip(homes.digest, homes.edges[:-1], homes.edges[1:], strict=True):
        old, new = before.get(digest), belief[lo:hi]
        if old is None or len(old) != len(new):
            continue
        near = np.abs(new - old) <= KEPT_LEVEL * np.sqrt(new * (1.0 - new))
        if (near & ((new >= least) == (old >= least))).all():
            kept[lo:hi] = old
    write_columns(
        folder / BELIEF, digest=np.array(homes.digest, np.str_), edges=np.array(homes.edges),
        belief=kept,
    )  # fmt: skip
    return kept


def _read(path: Path) -> Mapping[str, FloatArray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            belief = np.split(file["belief"], file["edges"][1:-1])
            return dict(zip(file["digest"].tolist(), belief, strict=True))
    except (OSError, KeyError, ValueError, BadZipFile):
        # missing, damaged or of another version: all is as computed
        return {}
