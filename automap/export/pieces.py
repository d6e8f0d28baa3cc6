"""Texts of very many signs, piece by piece: those that an older file has are taken from there.

A map that grows by a night's drives is the same in most places. Its signs are cut where their ids
say so, so a sign that comes or goes changes the piece that it is in and no other; a piece is named
by a digest of all that its text is made of, and an index beside each file says where which is.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple

from automap import __version__
from automap.io.atomic import atomic_path, write_json

USUAL, _MOST = 2048, 16_384
"""Signs of a piece: on average, and at most. A few MB of text, and one in some hundred pieces of
a map that an index pays for."""


class TextPiece(NamedTuple):
    """What ``make`` writes of some signs, and what names it: "" a text that is not kept."""

    key: str
    make: Callable[[], Iterable[bytes | memoryview]]


Text = bytes | memoryview | TextPiece


@cache
def code() -> str:
    """What writes signs and says what their classes mean: another version may do it otherwise."""
    root, whole = Path(__file__).resolve().parents[1], hashlib.sha256(__version__.encode())
    for path in sorted(p for name in ("export", "signs") for p in (root / name).rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            whole.update(path.read_bytes())
    return whole.hexdigest()


def edges_of(ids: Sequence[str]) -> list[int]:
    """Where signs [n] are cut: ascending numbers, 0 and n among them."""
    edges = [0]
    for k, name in enumerate(ids):
        cut = k > edges[-1] and zlib.crc32(name.encode("utf-8", "replace")) % USUAL == 0
        if cut or k - edges[-1] == _MOST:
            edges.append(k)
    return [*edges, len(ids)] if ids else edges


def flat(texts: Iterable[Text]) -> Iterator[bytes | memoryview]:
    """All that is to be written, one after another."""
    for text in texts:
        if isinstance(text, TextPiece):
            yield from text.make()
        else:
            yield text


class Span(NamedTuple):
    """Where a piece is in a file, the CRC-32 of its bytes there, and of what a packed file holds
    there the CRC-32 and the length."""

    start: int
    length: int
    crc: int
    text_crc: int = 0
    text_length: int = 0


@dataclass(frozen=True)
class Kept:
    """Pieces are kept for the next map, and taken from an ``older`` one's folder."""

    older: Path | None = None


@dataclass
class Index:
    """The pieces of a file: of the ``older`` one, and of the new one, ``spans``."""

    older: Path | None = None
    known: dict[str, Span] = field(default_factory=dict)
    spans: dict[str, Span] = field(default_factory=dict)

    def take(self, key: str) -> tuple[bytes, Span] | None:
        """The bytes of a piece in the older file; None where it has none, or others by now."""
        span = self.known.get(key)
        if span is None or self.older is None:
            return None
        with suppress(OSError), self.older.open("rb") as stream:
            stream.seek(span.start)
            data = stream.read(span.length)
            if len(data) == span.length and zlib.crc32(data) == span.crc:
                return data, span
        return None


def index_file(path: Path) -> Path:
    """Where the pieces of a file are listed."""
    return path.with_name(f".{path.name}.pieces")


def index_of(path: Path, kept: Kept | None) -> Index:
    """The index for a new file ``path``; what cannot be read is as nothing."""
    if kept is None or kept.older is None:
        return Index()
    older = kept.older / path.name
    with suppress(OSError, ValueError, TypeError, AttributeError):
        told = json.loads(index_file(older).read_text(encoding="utf-8"))
        return Index(older, {key: Span(*map(int, span)) for key, span in told.items()})
    return Index()


def write_pieces(path: Path, texts: Iterable[Text], kept: Kept | None = None) -> None:
    """Write texts one after another, atomically, and with ``kept`` the index of their pieces."""
    index = index_of(path, kept)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        for text in texts:
            if not isinstance(text, TextPiece):
                stream.write(text)
                continue
            start, crc = stream.tell(), 0
            found = index.take(text.key)
            for part in text.make() if found is None else (found[0],):
                stream.write(part)
                crc = zlib.crc32(part, crc)
            if text.key:
                index.spans[text.key] = Span(start, stream.tell() - start, crc)
    if kept is not None:
        write_json(index_file(path), index.spans)
