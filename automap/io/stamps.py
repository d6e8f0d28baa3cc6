"""Time stamps as recorded: rows out of order, repeats, jumps and clocks that were reset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.records import IntArray

_JUMP_NS = 1_000_000_000
"""A step back by more than this is a wrong stamp or a reset clock, not a late packet."""
_FAR_NS = 3600 * _JUMP_NS
"""A few rows at either end that lie this far from the rest bear wrong stamps."""
_FEW = 10
_MOST_NS = (1 << 62) - 1
"""Half of a 64-bit integer, 146 years from the clock's zero."""
_MAX_PIECES = 2000
_NEXT_STEPS = 10
"""Pieces of which one ends so many usual steps before another begins are one. Chosen: of a clock
that was started anew one in some thousand does so."""


@dataclass(frozen=True)
class LostPiece:
    """Rows ``first`` to ``last`` (as given, inclusive), left out for their stamps."""

    first: int
    last: int
    start_ns: int
    end_ns: int


@dataclass(frozen=True)
class StampOrder:
    """Which rows to keep, in which order, and what was wrong with the others.

    ``keep`` [k] are row indices that make the stamps strictly increase. ``reordered`` rows
    came late but belong where their stamps say; ``repeats`` rows bear a stamp that another
    row has; ``stepped_back`` rows lie in a stretch that the clock, set back by less than a
    second, passed twice; ``lost`` are pieces whose stamps fit nowhere.
    """

    keep: IntArray
    reordered: int = 0
    repeats: int = 0
    stepped_back: int = 0
    lost: tuple[LostPiece, ...] = ()


def order_stamps(t_ns: IntArray) -> StampOrder | None:
    """Put stamps [n] in order, keeping as many rows as possible.

    Rows that came late by less than a second are sorted in, unless they interleave with the
    earlier ones at double rate: then the clock was set back, and the second passage is left
    out. Pieces of a whole that stand in another order, as of a ring buffer, are put in order. Where
    stamps jump further, the pieces between jumps are chained so that time only increases and
    most rows stay: a single wrong stamp is lost alone, and of a recording whose clock was
    reset the larger part stays. None when the stamps jump so often that no clock can be seen
    in them.
    """
    # of others the difference is no 64-bit integer
    t_ns = np.clip(np.asarray(t_ns, dtype=np.int64), -_MOST_NS, _MOST_NS)
    rows = np.arange(len(t_ns), dtype=np.int64)
    steps = np.diff(t_ns)
    if np.all(steps > 0) and not np.any(steps > _FAR_NS):
        return StampOrder(rows)
    lost: tuple[LostPiece, ...] = ()
    if np.any(steps < -_JUMP_NS) or np.any(steps > _FAR_NS):
        chained = _chain(t_ns, steps)
        if chained is None:
            return None
        rows, lost = chained
    return _sort_late(t_ns, rows, lost)


def _chain(t_ns: IntArray, steps: IntArray) -> tuple[IntArray, tuple[LostPiece, ...]] | None:
    """Rows of the heaviest chain of pieces whose time increases, and the other pieces."""
    cuts = np.flatnonzero(np.abs(steps) > _JUMP_NS) + 1
    starts = np.concatenate([[0], cuts])
    ends = np.concatenate([cuts, [len(t_ns)]])
    if len(starts) > _MAX_PIECES:
        return None
    low = np.minimum.reduceat(t_ns, starts)
    high = np.maximum.reduceat(t_ns, starts)
    in_time = np.argsort(low)
    apart = low[in_time[1:]] - high[in_time[:-1]]
    usual = float(np.median(np.abs(steps)))
    if ((apart > 0) & (apart <= _NEXT_STEPS * usual)).all():
        return np.arange(len(t_ns)), ()
    weight = ends - starts
    best = weight.astype(np.int64)
    before = np.full(len(starts), -1)
    for piece in range(1, len(starts)):
        fits = np.flatnonzero(high[:piece] < low[piece])
        if len(fits):
            heaviest = fits[np.argmax(best[fits])]
            best[piece] += best[heaviest]
            before[piece] = heaviest
    kept = np.zeros(len(starts), dtype=bool)
    piece = int(np.argmax(best))
    while piece >= 0:
        kept[piece] = True
        piece = int(before[piece])
    _drop_far_ends(kept, low, high, weight)
    rows = np.concatenate([np.arange(starts[i], ends[i]) for i in np.flatnonzero(kept)])
    lost = tuple(
        LostPiece(int(starts[i]), int(ends[i] - 1), int(low[i]), int(high[i]))
        for i in np.flatnonzero(~kept)
    )
    return rows.astype(np.int64), lost


def _drop_far_ends(kept: np.ndarray, low: IntArray, high: IntArray, weight: IntArray) -> None:
    chain = list(np.flatnonzero(kept))
    while len(chain) > 1:
        if weight[chain[0]] < _FEW and low[chain[1]] - high[chain[0]] > _FAR_NS:
            kept[chain.pop(0)] = False
        elif weight[chain[-1]] < _FEW and low[chain[-1]] - high[chain[-2]] > _FAR_NS:
            kept[chain.pop()] = False
        else:
            return


def _sort_late(t_ns: IntArray, rows: IntArray, lost: tuple[LostPiece, ...]) -> StampOrder:
    stamps = t_ns[rows]
    reached = np.maximum.accumulate(stamps)
    late = np.zeros(len(rows), dtype=bool)
    late[1:] = stamps[1:] < reached[:-1]
    order = np.argsort(stamps, kind="stable")
    first = np.ones(len(rows), dtype=bool)
    first[1:] = np.diff(stamps[order]) > 0
    kept = order[first]
    late_kept = int(np.count_nonzero(late[kept]))
    if late_kept and _interleaved(stamps[kept], late[kept]):
        fresh = np.ones(len(rows), dtype=bool)
        fresh[1:] = stamps[1:] > reached[:-1]
        equal = np.zeros(len(rows), dtype=bool)
        equal[1:] = stamps[1:] == reached[:-1]
        return StampOrder(
            rows[fresh],
            repeats=int(np.count_nonzero(equal)),
            stepped_back=int(np.count_nonzero(late)),
            lost=lost,
        )
    return StampOrder(
        rows[kept], reordered=late_kept, repeats=int(np.count_nonzero(~first)), lost=lost
    )


def _interleaved(stamps: IntArray, late: np.ndarray) -> bool:
    """Whether late rows fall between earlier ones rather than into gaps that they left."""
    steps = np.diff(stamps)
    usual = float(np.median(steps))
    tight = steps < 0.75 * usual
    beside = late[1:] | late[:-1]
    return bool(np.count_nonzero(tight & beside) > 0.4 * np.count_nonzero(late))


def find_gaps(t_ns: IntArray, factor: float = 2.5) -> list[tuple[int, float]]:
    """Gaps between increasing stamps [n]: (stamp before it, length in s) for each step
    longer than ``factor`` median steps."""
    steps = np.diff(t_ns)
    if not len(steps):
        return []
    wide = np.flatnonzero(steps > factor * np.median(steps))
    return [(int(t_ns[i]), float(steps[i] * 1e-9)) for i in wide]
