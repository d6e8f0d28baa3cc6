"""Very many signs as columns, of which each is a record only while it is looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, overload

import numpy as np

from automap.records.arrays import FloatArray, IntArray
from automap.records.signs import Sign

_DEFAULTS = {f.name: f.default for f in fields(Sign) if f.default is not MISSING} | {
    f.name: f.default_factory() for f in fields(Sign) if f.default_factory is not MISSING
}


@dataclass(frozen=True)
class Names(Sequence[tuple[str, ...]]):
    """Some of ``names`` each [n]: those of ``code[first[k] : first[k + 1]]``."""

    names: Sequence[str]
    code: IntArray
    first: IntArray

    def __len__(self) -> int:
        return len(self.first) - 1

    @overload
    def __getitem__(self, k: int) -> tuple[str, ...]: ...
    @overload
    def __getitem__(self, k: slice) -> Names: ...
    def __getitem__(self, k: int | slice) -> tuple[str, ...] | Names:
        if isinstance(k, slice):
            lo, hi, _ = k.indices(len(self))
            return Names(self.names, self.code, self.first[lo : max(hi, lo) + 1])
        own = self.code[self.first[k] : self.first[k + 1]].tolist()
        return tuple(self.names[code] for code in own)

    def at(self, rows: IntArray) -> Names:
        """Those of some rows."""
        count = np.diff(self.first)[rows]
        first = np.concatenate([[0], np.cumsum(count)])
        shift = np.repeat(self.first[rows] - first[:-1], count)
        return Names(self.names, self.code[np.arange(first[-1]) + shift], first)


def joined_names(parts: Sequence[Names]) -> Names:
    """Those of one part [n] after those of another."""
    names = list(dict.fromkeys(name for part in parts for name in part.names))
    number = {name: k for k, name in enumerate(names)}
    code, first, count = [], [np.zeros(1, np.int64)], 0
    for part in parts:
        own = np.array([number[name] for name in part.names], np.int64)
        lo, hi = int(part.first[0]), int(part.first[-1])
        code.append(own[part.code[lo:hi]] if hi > lo else part.code[:0])
        first.append(part.first[1:] - lo + count)
        count += hi - lo
    return Names(names, np.concatenate(code), np.concatenate(first))


@dataclass(frozen=True)
class SignList(Sequence[Sign]):
    """Signs [n]: ``columns`` by fields of ``records.Sign``, arrays, lists or Names [n], the others
    being as by default, and their ``cov_enu`` [n, 3, 3]. A list of half a million records is a
    gigabyte."""

    columns: Mapping[str, Any]
    cov_enu: FloatArray

    def __len__(self) -> int:
        return len(self.cov_enu)

    @overload
    def __getitem__(self, k: int) -> Sign: ...
    @overload
    def __getitem__(self, k: slice) -> SignList: ...
    def __getitem__(self, k: int | slice) -> Sign | SignList:
        if isinstance(k, slice):
            own = {name: column[k] for name, column in self.columns.items()}
            return SignList(own, self.cov_enu[k])
        values = {name: column[k] for name, column in self.columns.items()}
        own = {n: v.item() if isinstance(v, np.generic) else v for n, v in values.items()}
        return Sign(cov_enu=self.cov_enu[k], **own)

    def lacking(self) -> str:
        """A field that has no default and no column; "" where all are there."""
        needed = (f.name for f in fields(Sign) if f.name not in _DEFAULTS)
        return next((name for name in needed if name not in {"cov_enu", *self.columns}), "")

    def at(self, rows: IntArray) -> SignList:
        """Those of some rows."""
        own = {
            name: column[rows]
            if isinstance(column, np.ndarray)
            else column.at(rows)
            if isinstance(column, Names)
            else [column[k] for k in rows.tolist()]
            for name, column in self.columns.items()
        }
        return SignList(own, self.cov_enu[rows])


def values_of(signs: Sequence[Sign], field: str) -> Any:
    """A field [n] of all signs, without a record of each where they are columns."""
    if not isinstance(signs, SignList):
        return [getattr(sign, field) for sign in signs]
    if field == "cov_enu":
        return signs.cov_enu
    if field not in signs.columns:
        return [_DEFAULTS[field]] * len(signs)
    return signs.columns[field]


def numbers_of(signs: Sequence[Sign], *names: str) -> tuple[FloatArray, ...]:
    """Fields [n] of all signs that are numbers."""
    return tuple(np.asarray(values_of(signs, name), np.float64) for name in names)


def changed(signs: Sequence[Sign], **columns: Sequence[Any]) -> Sequence[Sign]:
    """The signs [n] with other values [n] in some fields."""
    if isinstance(signs, SignList):
        return SignList({**signs.columns, **columns}, signs.cov_enu)
    rows = zip(*columns.values(), strict=True)
    return [
        replace(sign, **dict(zip(columns, row, strict=True)))
        for sign, row in zip(signs, rows, strict=True)
    ]
