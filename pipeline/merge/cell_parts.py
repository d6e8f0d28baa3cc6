"""The files that hold what drives brought into a cell: one a batch of drives, many packed to one.

A fleet that drives every night brings a file a night into every cell that it touches. A file of
several batches bears the first and the last one's name, and those that it holds count no more, so
that it may be ended anywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from automap.io.cell_tables import pack_points
from automap.mapping.cells import quadkey

MOST_PARTS = 32
"""Files of a cell that are read one by one, some ms each; packing copies a cell's 3 MB once in so
many nights."""


def parts(folder: Path, kind: str, cells: Iterable[int]) -> list[Path]:
    """The files of some cells, which hold every row once."""
    return [path for cell in map(int, cells) for path in _counting(_files(folder, kind, cell))]


def pack(
    folder: Path, kind: str, cell: int, later: Mapping[str, float | str] | None = None
) -> None:
    """Put the files of a cell into one where they are too many; ``later`` as in ``read_points``."""
    files = _files(folder, kind, cell)
    counting = _counting(files)
    if len(counting) > MOST_PARTS:
        whole = counting[0].with_stem(f"{_span(counting[0])[0]}-{_span(counting[-1])[1]}")
        pack_points(whole, counting, later or {})
        counting = [whole]
    for path in set(files) - set(counting):
        path.unlink()


def _files(folder: Path, kind: str, cell: int) -> list[Path]:
    return sorted((folder / kind / f"cell={quadkey(cell)}").glob("*.parquet"))


def _counting(files: Sequence[Path]) -> list[Path]:
    """Those that no other one of them holds."""
    spans = [_span(path) for path in files]
    return [
        path
        for path, own in zip(files, spans, strict=True)
        if not any(a <= own[0] and own[1] <= b for a, b in spans if (a, b) != own)
    ]


def _span(path: Path) -> tuple[str, str]:
    """The first and the last batch that a file holds."""
    first, _, last = path.stem.partition("-")
    return first, last or first
