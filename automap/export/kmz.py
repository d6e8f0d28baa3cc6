"""``map.kmz``: a KML document with the pictures it shows in one archive."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import IO

from automap.export.pieces import Index, Kept, Span, Text, TextPiece, flat, index_file, index_of
from automap.io.atomic import atomic_path, write_json

DOCUMENT = "doc.kml"
_DATE = (1980, 1, 1, 0, 0, 0)
_POLYNOMIAL = 0xEDB88320
"""Of CRC-32, its bits turned round."""


def write_kmz(
    path: Path,
    document: Iterable[Text],
    files: Mapping[str, bytes],
    large: bool = False,
    kept: Kept | None = None,
) -> None:
    """Write the document and the files that it refers to by these names; ``large`` where the
    document may be more than 2 GB, which is a form of archive of its own (ZIP64).

    The document comes first in the archive, as readers expect; the same content gives the same
    bytes. Each piece of it is packed by itself, so that with ``kept`` it can be taken over packed.
    """
    index = index_of(path, kept)
    with atomic_path(path) as temporary:
        with zipfile.ZipFile(temporary, "w") as archive:
            head = zipfile.ZipInfo(DOCUMENT, _DATE)
            with archive.open(head, "w", force_zip64=large) as stream:
                crc, length = _pack(stream, document, index)
            # what was written is the packed text
            head.compress_type, head.CRC, head.file_size = zipfile.ZIP_DEFLATED, crc, length
            header = head.FileHeader(large)
            for name, data in files.items():
                # pictures are compressed already
                archive.writestr(zipfile.ZipInfo(name, _DATE), data, zipfile.ZIP_STORED)
        with temporary.open("r+b") as whole:
            whole.seek(head.header_offset)
            whole.write(header)
        for key, span in index.spans.items():
            index.spans[key] = span._replace(start=span.start + head.header_offset + len(header))
    if kept is not None:
        write_json(index_file(path), index.spans)


def _pack(stream: IO[bytes], document: Iterable[Text], index: Index) -> tuple[int, int]:
    """Write the document packed; the CRC-32 of its text and how long that is."""
    at, crc, length = 0, 0, 0
    for key, parts in _segments(document):
        if (found := index.take(key)) is not None:
            packed, span = found
            stream.write(packed)
            span = span._replace(start=at)
        else:
            span = _packed(stream, at, parts)
        if key:
            index.spans[key] = span
        at += span.length
        crc, length = joined_crc(crc, span.text_crc, span.text_length), length + span.text_length
    stream.write(zlib.compressobj(wbits=-15).flush())
    return crc, length


def _segments(document: Iterable[Text]) -> Iterator[tuple[str, Iterable[bytes | memoryview]]]:
    """Keys and texts: each piece by itself, and what stands between two in one."""
    for is_piece, texts in groupby(document, lambda text: isinstance(text, TextPiece)):
        if not is_piece:
            yield "", flat(texts)
            continue
        for text in texts:
            assert isinstance(text, TextPiece)
            # another version may pack otherwise
            yield text.key and f"{text.key} {zlib.ZLIB_RUNTIME_VERSION}", flat([text])


def _packed(stream: IO[bytes], start: int, parts: Iterable[bytes | memoryview]) -> Span:
    """Write a text packed, from byte ``start`` on."""
    pack, size, crc, text_crc, text_length = zlib.compressobj(wbits=-15), 0, 0, 0, 0

    def put(packed: bytes) -> None:
        nonlocal size, crc
        stream.write(packed)
        size, crc = size + len(packed), zlib.crc32(packed, crc)

    for part in parts:
        text_crc, text_length = zlib.crc32(part, text_crc), text_length + len(part)
        put(pack.compress(part))
    # ends at a byte, and is not the last block
    put(pack.flush(zlib.Z_FULL_FLUSH))
    return Span(start, size, crc, text_crc, text_length)


def joined_crc(first: int, second: int, length: int) -> int:
    """The CRC-32 of two texts one after another by those of both and the second's ``length`` in
    bytes (zlib's crc32_combine)."""
    # x to the power of 8 length, modulo the polynomial
    power, bits = 1 << 31, 8 * length
    for square in _squares():
        if bits & 1:
            power = _product(square, power)
        bits >>= 1
    return _product(power, first) ^ second


@cache
def _squares() -> tuple[int, ...]:
    """x to the power of 1, 2, 4, 8 and so on, for lengths below 2^61."""
    found = [1 << 30]
    while len(found) < 64:
        found.append(_product(found[-1], found[-1]))
    return tuple(found)


def _product(a: int, b: int) -> int:
    """Of two polynomials modulo that of CRC-32."""
    product = 0
    for bit in range(31, -1, -1):
        if a >> bit & 1:
            product ^= b
        b = b >> 1 ^ (_POLYNOMIAL if b & 1 else 0)
    return product
