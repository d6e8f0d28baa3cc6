"""What the map calls the signs of each drive, of very many drives in little memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from automap.records import BoolArray, IntArray
from pipeline.merge.cell_steps import Members


class OwnNames:
    """Of each drive the numbers of its signs among those of the cells, by their ids there, as far
    as they are ``in_map`` [m]. Ten million sightings are some twenty bytes each until a drive's are
    asked for; as texts of their own they would be gigabytes."""

    def __init__(self, cells: Iterable[Members], in_map: BoolArray) -> None:
        none = np.zeros(0, np.int64)
        drive, sign, own = [none], [none.astype(np.int32)], [np.zeros(0, np.bytes_)]
        for cell in cells:
            rows = np.flatnonzero(in_map[cell.sign])
            drive.append(cell.drive[rows])
            sign.append(cell.sign[rows].astype(np.int32))
            own.append(np.char.encode(cell.id[rows], "utf-8"))
        who = np.concatenate(drive)
        # one after another as the cells have them: of two of one name the last counts
        order = np.argsort(who, kind="stable")
        self._drive: IntArray = who[order]
        self._sign = np.concatenate(sign)[order]
        self._own = np.concatenate(own)[order]

    def of(self, drive: int) -> Mapping[str, int]:
        """The drive's."""
        at = slice(*np.searchsorted(self._drive, [drive, drive + 1]).tolist())
        own = [name.decode() for name in self._own[at].tolist()]
        return dict(zip(own, self._sign[at].tolist(), strict=True))
