"""What the map calls the signs of each drive, of very many drives in little memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from automap.records import IntArray
from pipeline.merge.cell_steps import Members


class OwnNames:
    """Of each drive its signs' ids in the map by their own. Ten million sightings are some twenty
    bytes each until a drive's are asked for; as texts of their own they would be gigabytes."""

    def __init__(self, cells: Iterable[Members], ids: Sequence[str]) -> None:
        self._ids = ids
        none = np.zeros(0, np.int64)
        drive, sign, own = [none], [none.astype(np.int32)], [np.zeros(0, np.bytes_)]
        in_map = np.array([bool(name) for name in ids], np.bool_)
        for cell in cells:
            rows = np.flatnonzero(in_map[cell.sign])
            drive.append(cell.drive[rows])
            sign.append(cell.sign[rows].astype(np.int32))
            own.append(np.array([cell.id[k].encode() for k in rows.tolist()], np.bytes_))
        who = np.concatenate(drive)
        # one after another as the cells have them: of two of one name the last counts
        order = np.argsort(who, kind="stable")
        self._drive: IntArray = who[order]
        self._sign = np.concatenate(sign)[order]
        self._own = np.concatenate(own)[order]

    def of(self, drive: int) -> Mapping[str, str]:
        """Ids in the map by the drive's own."""
        at = slice(*np.searchsorted(self._drive, [drive, drive + 1]).tolist())
        pairs = zip(self._own[at].tolist(), self._sign[at].tolist(), strict=True)
        return {own.decode(): self._ids[sign] for own, sign in pairs}
