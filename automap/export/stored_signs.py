"""Signs of a large map, read part by part from the table that holds them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from automap.export.assembly import OnPost, on_post
from automap.export.fields import SIGN_FIELDS, Field
from automap.export.pieces import code, edges_of
from automap.export.sign_columns import SignColumns, SignPiece, columns_of, on_map, wrap_degrees
from automap.export.uncertainty import ce95
from automap.io.signs_table import SignRows, sign_pieces, sign_values
from automap.records import BoolArray, ClockModel, FloatArray, IntArray

ROWS = 16_384
"""Signs at once: in all formats some 100 MB."""


class _Face(NamedTuple):
    id: str
    class_name: str
    height_m: float
    size_m: float
    facing_rad: float
    support: str


@dataclass(frozen=True)
class StoredSigns:
    """Signs [n] of a table ``path``, as ``sign_columns.Signs`` says. Whole are, besides positions
    and ``classes``, ``geoid_m`` (NaN unknown), the covariance ``cov_m2`` [n, 3] east, east-north,
    north, the number of ``drives``, and where they ``hung`` on posts that parts may divide."""

    path: Path
    lon_deg: FloatArray
    lat_deg: FloatArray
    height_m: FloatArray
    geoid_m: FloatArray
    cov_m2: FloatArray
    classes: Sequence[str]
    drives: IntArray
    hung: OnPost
    clock: ClockModel | None
    country: str | None
    utc_known: bool
    edges: Sequence[int]
    """Where ``pieces`` are cut."""
    keys: Sequence[str] = ()

    def __len__(self) -> int:
        return len(self.lon_deg)

    @property
    def fields(self) -> tuple[Field, ...]:
        """What every format writes: they have no place on roads."""
        return SIGN_FIELDS

    @property
    def located(self) -> BoolArray:
        """Which signs [n] have a position that a map can show."""
        return on_map(self.lon_deg, self.lat_deg)

    def parts(self) -> Iterator[SignColumns]:
        """All of them, in their order."""
        start = 0
        for piece in sign_pieces(self.path, ROWS):
            yield self._columns(piece, start)
            start += len(piece)

    def pieces(self) -> Iterator[SignPiece]:
        """All of them, cut; their rows are read only where they are wanted."""
        rows = SignRows(self.path)
        keys = self.keys or [""] * (len(self.edges) - 1)
        for (lo, hi), key in zip(pairwise(self.edges), keys, strict=True):
            yield SignPiece(lo, hi, partial(self._rows, rows, lo, hi), key)

    def _rows(self, rows: SignRows, lo: int, hi: int) -> SignColumns:
        return self._columns(rows.between(lo, hi), lo)

    def keyed(self) -> StoredSigns:
        """The same whose pieces are named by all that is in them."""
        rows, known = SignRows(self.path), (code(), repr(self.clock), self.country)
        keys = []
        for lo, hi in pairwise(self.edges):
            hung = self.hung.order[lo:hi], self.hung.main[lo:hi]
            whole = hashlib.blake2b(repr((known, hung)).encode(), digest_size=16)
            whole.update(self.geoid_m[lo:hi].tobytes())
            for column in rows.between(lo, hi).combine_chunks().columns:
                _update(whole, column.chunk(0))
            keys.append(whole.hexdigest())
        return replace(self, keys=keys)

    def first(self, count: int) -> SignColumns:
        """The first ``count``."""
        return self._columns(next(sign_pieces(self.path, max(count, 1))), 0)

    def radii_m(self) -> FloatArray:
        """Radii [n] of the 95 % circles."""
        return ce95(*self.cov_m2.T)

    def seen_by(self) -> IntArray:
        """How many drives [n] saw each."""
        return self.drives

    def _columns(self, piece: Any, start: int) -> SignColumns:
        own = slice(start, start + len(piece))
        found = columns_of(
            lambda field: sign_values(piece, field), sign_values(piece, "cov_enu"),
            OnPost(self.hung.order[own], self.hung.main[own]), self.clock, self.country,
        )  # fmt: skip
        found.values["height_msl_m"] = found.height_m - self.geoid_m[own]
        return found


def _update(digest: Any, column: Any) -> None:
    """Add all values of an Arrow array, and no byte that lies between or behind them."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_list(column.type):
        digest.update(pc.list_value_length(column).fill_null(-1).to_numpy())
        _update(digest, column.flatten())
    elif pa.types.is_string(column.type):
        digest.update(pc.binary_length(column).fill_null(-1).to_numpy())
        _, edges, texts = column.buffers()
        if len(column) and texts is not None:
            own = np.frombuffer(edges, np.int32)[column.offset : column.offset + len(column) + 1]
            digest.update(memoryview(texts)[own[0] : own[-1]])
    else:
        digest.update(np.ascontiguousarray(column.to_numpy(zero_copy_only=False)))


def stored_signs(
    path: Path, clock: ClockModel | None, country: str | None, geoid: bool
) -> StoredSigns:
    """The signs of a table that this version wrote; ``geoid`` whether its heights count."""
    few = (
        "id", "class_name", "lat_rad", "lon_rad", "height_m", "size_m", "facing_rad", "support",
        "geoid_m", "cov_enu", "drives",
    )  # fmt: skip
    parts: dict[str, list[Any]] = {name: [] for name in few}
    known: dict[str, str] = {}
    for piece in sign_pieces(path, ROWS, few):
        for name in few:
            if name == "drives":
                # names of as many drives as saw each sign are not wanted
                parts[name].append(np.diff(np.asarray(piece["drives"].offsets, np.int64)))
                continue
            values = sign_values(piece, name)
            if name == "class_name":
                values = [known.setdefault(text, text) for text in values]
            parts[name].append(values)
    whole: dict[str, Any] = {
        name: [text for part in own for text in part]
        if name in ("id", "class_name", "support")
        else np.concatenate(own)
        for name, own in parts.items()
    }
    cov = whole["cov_enu"]
    return StoredSigns(
        path, wrap_degrees(np.degrees(whole["lon_rad"])), np.degrees(whole["lat_rad"]),
        whole["height_m"], whole["geoid_m"] if geoid else np.full(len(cov), np.nan),
        np.column_stack([cov[:, 0, 0], cov[:, 0, 1], cov[:, 1, 1]]), whole["class_name"],
        whole["drives"], _hung(whole), clock, country, clock is not None,
        edges_of(whole["id"]),
    )  # fmt: skip


def _hung(whole: dict[str, Any]) -> OnPost:
    """Where all hang: most are alone on their posts, and the first face there."""
    support = whole["support"]
    _, post, count = np.unique(np.array(support), return_inverse=True, return_counts=True)
    alone = (count[post] == 1) & np.isfinite(whole["height_m"]) & (np.array(support) != "")
    order: list[int | None] = [1 if one else None for one in alone.tolist()]
    main: list[str | None] = [None] * len(order)
    rows = np.flatnonzero(count[post] > 1).tolist()
    faces = [_Face(*(whole[name][k] for name in _Face._fields)) for k in rows]
    together = on_post(faces)
    for k, place, head in zip(rows, together.order, together.main, strict=True):
        order[k], main[k] = place, head
    return OnPost(order, main)
