"""The messages of one type, addressed by epoch."""

from __future__ import annotations

import numpy as np

from automap.io.epoch_join import Joined
from automap.io.nmea import NmeaTable
from automap.io.ubx import Table, physical
from automap.records import BoolArray, FloatArray, IntArray

Epochs = IntArray | slice
"""Epochs by number, or all of them as a slice, for which nothing has to be gathered."""


def select(mask: BoolArray) -> Epochs:
    """The epochs where ``mask`` [m] is set."""
    return slice(None) if mask.all() else np.flatnonzero(mask)


def among(epochs: Epochs, mask: BoolArray) -> Epochs:
    """Those of ``epochs`` [k] where ``mask`` [k] is set."""
    if mask.all():
        return epochs
    kept = np.flatnonzero(mask)
    return kept if isinstance(epochs, slice) else np.asarray(epochs[kept], np.int64)


class Source:
    """A message type of a log: ``has`` [m] says which epochs have it."""

    def __init__(
        self, name: str, joined: Joined, ubx: dict[str, Table], nmea: dict[str, NmeaTable]
    ) -> None:
        self.name = name
        self.row = joined.rows[name]
        self.has: BoolArray = self.row >= 0
        self._ubx = ubx.get(name)
        self._nmea = nmea.get(name)
        offset = self._ubx["offset"] if self._ubx is not None else nmea[name]["offset"]
        self._one_each = len(offset) == len(self.row) and bool(
            np.array_equal(self.row, np.arange(len(self.row), dtype=np.int32))
        )

    def _rows(self, epochs: Epochs) -> IntArray | slice:
        if isinstance(epochs, slice) and self._one_each:
            return epochs
        return self.row[epochs].astype(np.int64)

    def value(self, field: str, epochs: Epochs) -> FloatArray:
        """A field in its unit [k] at epochs [k] that have this type; not to be changed."""
        rows = self._rows(epochs)
        if self._ubx is not None:
            return physical(self.name, self._ubx, field, rows)
        assert self._nmea is not None
        return np.asarray(self._nmea[field][rows], np.float64)

    def counts(self, field: str, epochs: Epochs) -> IntArray:
        """An integer UBX field [k] as it was sent, in its own width; not to be changed."""
        assert self._ubx is not None
        column: IntArray = self._ubx[field][self._rows(epochs)]
        return column
