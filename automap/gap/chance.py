"""How likely the strongest of all candidates reaches so much where none acts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.gap import limits
from automap.gap.evidence import by_scale, single_nats
from automap.gap.linear import Conditional, Linear, Part, conditional
from automap.gap.rows import Rows, moments
from automap.gap.whitening import LOOSE
from automap.records import FloatArray, IntArray

SINGULAR = 1e-6
"""Share of its variance by which a score is drawn too large, so that a matrix has a root."""
COLUMNS = 256
"""Candidates that are drawn together; bounds the memory."""
DRAWS = 500
"""Draws that are made together; bounds the memory."""
TIE = 1e-9
"""Draws that differ by less than rounding are one."""


def null_maxima(known: Conditional, parts: Sequence[Part], draws: int, seed: int = 1) -> FloatArray:
    """The largest evidence [draws] over parts where none of them acts, sorted.

    Scores are drawn from their own covariance, so the overlap of the candidates counts.
    """
    rng = np.random.default_rng(seed)
    columns = np.array(sorted({i for part in parts for i in part}), np.int64)
    sizes, sds = known.diagonal[columns], known.linear.prior_sd[columns]
    mixing, info = known.linear.mixing, known.of_rows()
    # thousands of courses are made of hundreds of boxes: those are drawn
    info = info[np.ix_(columns, columns)] if mixing is None else info.copy()
    unit = np.sqrt(np.maximum(np.diag(info), 1e-300))
    info /= np.outer(unit, unit)
    # scores of columns that others make up are singular
    info[np.diag_indices(len(info))] += SINGULAR
    # what is drawn is known to far less than single precision
    root = np.linalg.cholesky(info).T.astype(np.float32)
    single = np.searchsorted(columns, [part[0] for part in parts if len(part) == 1])
    joint = []
    for length in sorted({len(part) for part in parts} - {1}):
        every = np.array([part for part in parts if len(part) == length])
        joint.append((np.searchsorted(columns, every), known.infos(every)))
    best = np.full(draws, -np.inf)
    for start in range(0, draws, DRAWS):
        some = best[start : start + DRAWS]
        normal = rng.standard_normal((len(some), len(unit)))
        g = np.asarray((normal.astype(np.float32) @ root) * unit, np.float64)
        if mixing is not None:
            g = mixing.of(g)[:, columns]
        if len(single):
            own = sizes[single]
            some[:] = single_nats(g[:, single] ** 2 / own, own, sds[single]).max(axis=1)
        for at, infos in joint:
            some[:] = np.maximum(some, by_scale(g[:, at], infos, sds[at]).max(axis=(0, 2)))
    return np.sort(best)


def p_value(nats: float, maxima: FloatArray) -> float:
    """Share of ``maxima`` [draws], sorted, that reach ``nats``; beyond them by their exponential
    tail (Pickands' theorem with shape zero)."""
    n = len(maxima)
    above = n - int(np.searchsorted(maxima, nats))
    top = max(n // 50, 10)
    if above >= top:
        return above / n
    threshold = float(maxima[n - top])
    mean_excess = max(float(np.mean(maxima[n - top :] - threshold)), 1e-3)
    return float(top / n * np.exp(-(nats - threshold) / mean_excess))


@dataclass(frozen=True)
class Strongest:
    """Of many parts the one that explains most, stretch by stretch: its number among them, what
    has a say of it, its nats, and the chance that the strongest of all reaches as much where none
    acts."""

    number: int
    known: Conditional
    nats: float
    p_value: float


def strongest_by_chance(known: Conditional, parts: Sequence[Part], draws: int) -> Strongest | None:
    """The strongest of ``parts``, judged by the drives' own scatter; None without any that shows.

    Where nothing is missing, what a stretch says of a candidate might as well have had the other
    sign: whatever noise makes of the stretches, and however long it lasts within one. So all
    stretches of half a minute are given signs at random (the wild bootstrap of scores by clusters:
    Kline and Santos, Journal of Econometric Methods 1 (2012), 23-41). Of few stretches there are
    few such draws, and no chance is told below the share of the drawn one itself.

    What the vehicle constraint says has no such sign: a body that sways against its path turns the
    gyro with it, so the constraint's errors go along with all that is made of small turn rates. It
    has a say of what acts on the vehicle itself, and of nothing else.
    """
    received = conditional(_received(known.linear), known.given)
    sides: list[tuple[Conditional, list[int]]] = [(known, []), (received, [])]
    for number, part in enumerate(parts):
        side, mine = sides[0 if known.linear.of_vehicle(part) else 1]
        if side.shows(part):
            mine.append(number)
    signs: FloatArray | None = None
    best, seen = np.full(draws, -np.inf), np.full(len(parts), -np.inf)
    for side, mine in sides:
        if not mine:
            continue
        scores = _by_stretch(side)
        if signs is None:
            signs = np.random.default_rng(1).choice([-1.0, 1.0], size=(draws, len(scores)))
            signs[0] = 1.0
        for nats, numbers in _drawn(side, parts, mine, scores, signs):
            seen[numbers] = nats[0]
            best = np.maximum(best, nats.max(axis=1))
    if signs is None:
        return None
    number = int(np.argmax(seen))
    own = next(side for side, mine in sides if number in mine)
    return Strongest(number, own, float(seen[number]), int(np.sum(best >= best[0] - TIE)) / draws)


def _drawn(
    known: Conditional,
    parts: Sequence[Part],
    numbers: Sequence[int],
    scores: FloatArray,
    signs: FloatArray,
) -> Iterator[tuple[FloatArray, IntArray]]:
    """Nats [draws, k] of some of ``parts`` and their ``numbers`` [k] for ``signs`` [draws, b] of
    the stretches' ``scores`` [b, v]; the scatter of a part is its own."""
    single = np.array([i for i in numbers if len(parts[i]) == 1], np.int64)
    for start in range(0, len(single), COLUMNS):
        some = single[start : start + COLUMNS]
        columns = np.array([parts[i][0] for i in some])
        own, info = scores[:, columns], known.diagonal[columns]
        squares = (signs @ own) ** 2 / np.maximum((own**2).sum(axis=0), info)
        yield single_nats(squares, info, known.linear.prior_sd[columns]), some
    for i in (i for i in numbers if len(parts[i]) > 1):
        at = list(parts[i])
        own, info = scores[:, at], known.info(parts[i])
        white = np.linalg.solve(np.linalg.cholesky(info), own.T)
        size = max(float((white**2).sum()) / len(at), 1.0)
        one = (signs @ own)[:, None], info[None], known.linear.prior_sd[[at]]
        yield by_scale(*one, size).max(axis=0), np.array([i])


def _received(linear: Linear) -> Linear:
    """The same with nothing said by the vehicle constraint; as many rows."""
    rows = []
    for r in linear.rows:
        kept = ~np.isin(r.channel, LOOSE)
        rows.append(Rows(r.w * kept, r.phi * kept[:, None], r.t, r.channel))
    score, info = (sum(each) for each in zip(*map(moments, rows), strict=True))
    if linear.mixing is not None:
        score = linear.mixing.of(score)
    return replace(linear, rows=tuple(rows), score=score, info=info)


def _by_stretch(known: Conditional) -> FloatArray:
    """Scores [b, v] of all columns from stretches of the drives, what is given taken out."""
    linear, given = known.linear, list(known.given.columns)
    out = []
    for rows in linear.rows:
        w = rows.w
        if given:
            w = w - linear.columns(rows, given) @ known.value
        number = ((rows.t - rows.t.min(initial=np.inf)) / limits.BLOCKS_S[-1]).astype(np.int64)
        order = np.argsort(number, kind="stable")
        edges = np.flatnonzero(np.diff(number[order], prepend=-1))
        for start, stop in zip(edges, [*edges[1:], len(order)], strict=True):
            at = order[start:stop]
            out.append(rows.phi[at].astype(np.float64).T @ w[at])
    scores = np.array(out).reshape(len(out), -1)
    if linear.mixing is not None:
        scores = linear.mixing.of(scores)
    return np.asarray(scores - scores[:, given] @ known.weights)
