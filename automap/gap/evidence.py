"""Evidence of a candidate beside those that are in a model already, robust to what noise does.

With score g, information I and prior covariance S, those of the others marginalised, the log Bayes
factor of a candidate against nothing is 1/2 g' (I + S^-1)^-1 g - 1/2 log det(1 + S I): Laplace's
approximation, exact for a linear model with Gaussian noise (MacKay 2003, chapter 28). It pays for
every parameter that the drive shows, and for none that it does not.

Noise is never quite as a model has it. So the score's scatter from stretch to stretch is compared
with what it should be (the sandwich of White 1980, stretches as clusters), and evidence lowered by
their ratio; and what a candidate explains must be predicted for each stretch from the others
(cross-validation), also without the stretch that speaks most for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automap.gap import limits
from automap.gap.linear import Conditional, Part, Side
from automap.gap.stretches import Frame
from automap.gates import exceeds
from automap.records import FloatArray, IntArray

MEDIAN_SQUARE = 0.4549
"""Median of the square of a standard normal value."""


@dataclass(frozen=True)
class Evidence:
    """Of one part: log Bayes factor in nats, estimate [p], sd [p], factor on its prior, factor by
    which its score scatters more than it should, nats before these were lowered for it, the part of
    them that is, and the nats that other stretches predict for each (all, and without the best)."""

    nats: float
    estimate: FloatArray
    sd: FloatArray
    scale: float
    overdispersion: float
    uncorrected: float
    fixed: float
    predicted: float
    predicted_without_best: float

    def corrected(self, ratio: float) -> float:
        """Nats where the score scatters by ``ratio`` more than it should."""
        return self.uncorrected - self.fixed * (1.0 - 1.0 / max(ratio, 1.0))


def plain_nats(known: Conditional, part: Part) -> tuple[float, float]:
    """Nats of a part under the noise as modelled, and the factor on its prior."""
    at = np.array([part])
    nats = by_scale(known.score[at], known.infos(at), known.linear.prior_sd[at])[:, 0]
    # of equal ones the first
    best = int(np.argmax(nats >= nats.max() - 1e-9))
    return float(nats[best]), limits.PRIOR_SCALES[best]


def nats_of_parts(known: Conditional, parts: Sequence[Part]) -> FloatArray:
    """The nats of many parts [k], those of one length together."""
    out = np.full(len(parts), -np.inf)
    lengths = np.array([len(part) for part in parts])
    for length in np.unique(lengths):
        mine = np.flatnonzero(lengths == length)
        at = np.array([part for part in parts if len(part) == length])
        if length == 1:
            out[mine] = singles(known, at[:, 0])
            continue
        nats = by_scale(known.score[at], known.infos(at), known.linear.prior_sd[at])
        out[mine] = nats.max(axis=0)
    return out


def by_scale(
    g: FloatArray, info: FloatArray, prior_sd: FloatArray, ratio: float = 1.0
) -> FloatArray:
    """Nats [scales, ..., k] of parts of scores [..., k, p], information [k, p, p] and prior sds
    [k, p], where scores scatter by ``ratio`` more than they should."""
    out = [bayes_factors(g, info, scale * prior_sd, ratio) for scale in limits.PRIOR_SCALES]
    return np.asarray(np.array(out) - np.log(len(limits.PRIOR_SCALES)))


def bayes_factors(
    g: FloatArray, info: FloatArray, sd: FloatArray, ratio: float = 1.0
) -> FloatArray:
    """The same [..., k] for one scale."""
    inner = info * sd[:, :, None] * sd[:, None, :] + np.eye(sd.shape[1])
    sign, size = np.linalg.slogdet(inner)
    y = sd * g
    squares = np.einsum("...kp,kpq,...kq->...k", y, np.linalg.inv(inner), y)
    return np.asarray(np.where(sign > 0.0, 0.5 * (squares / ratio - size), -np.inf))


def singles(known: Conditional, columns: IntArray) -> FloatArray:
    """The nats of many columns [k], each a part of its own."""
    info = known.diagonal[columns]
    squares = known.score[columns] ** 2 / np.maximum(info, 1e-300)
    return single_nats(squares, info, known.linear.prior_sd[columns])


def single_nats(squares: FloatArray, info: FloatArray, prior_sd: FloatArray) -> FloatArray:
    """Nats [..., k] of single parameters of squared sigmas [..., k], information [k] and prior sds
    [k]."""
    best = np.full(squares.shape, -np.inf)
    for scale in limits.PRIOR_SCALES:
        room = info * (scale * prior_sd) ** 2
        best = np.maximum(best, 0.5 * squares * room / (1.0 + room) - 0.5 * np.log1p(room))
    return np.asarray(best - np.log(len(limits.PRIOR_SCALES)))


def inflation(known: Conditional, columns: IntArray) -> float:
    """By how much the scores of columns [k], most of which can be missing from nothing, are larger
    than those of noise as modelled; at least one.

    The median of their squares over what it is for a normal one (genomic control: Devlin and
    Roeder, Biometrics 55 (1999), 997-1004), shrunk where the columns are but a few different ones.
    """
    columns = columns[known.shown[columns]]
    if len(columns) < 2:
        return 1.0
    ratio = float(np.median(known.score[columns] ** 2 / known.diagonal[columns])) / MEDIAN_SQUARE
    different = len(columns) ** 2 / known.shared(columns)
    shrink = limits.SHRINK_BLOCKS
    return max(1.0, (different * ratio + shrink) / (different + shrink))


def evidence(known: Conditional, part: Part, least_ratio: float = 1.0) -> Evidence:
    """Evidence of a part, corrected for noise that is not as modelled: its score scatters by
    ``least_ratio`` more than it should or, stretch by stretch, by more."""
    linear, at = known.linear, list(part)
    nats, scale = plain_nats(known, part)
    g, info = known.score[at], known.info(part)
    sd = scale * linear.prior_sd[at]
    cov = np.linalg.inv(info + np.diag(sd**-2.0))
    estimate = cov @ g
    if not (np.isfinite(nats) and estimate.any()):
        zero = np.zeros(len(at))
        return Evidence(-np.inf, zero, zero, scale, 1.0, -np.inf, 0.0, -np.inf, -np.inf)
    rows = _stacked(known, part)
    ratio = max(_ratio(rows, estimate), least_ratio)
    if not linear.of_vehicle(part) and _contradicted(rows, linear.sides, estimate, least_ratio):
        alone = rows.side(linear.sides[1])
        its_g, its_info = alone.phi.T @ alone.w, alone.phi.T @ alone.phi
        its_nats = float(bayes_factors(its_g[None], its_info[None], sd[None])[0])
        its_nats -= np.log(len(limits.PRIOR_SCALES))
        its_cov = np.linalg.inv(its_info + np.diag(sd**-2.0))
        its_ratio = max(_ratio(alone, its_cov @ its_g), least_ratio)
        lowered = 0.5 * (1.0 - 1.0 / np.array([ratio, its_ratio]))
        its_own = its_nats - lowered[1] * float(its_g @ its_cov @ its_g)
        # one of the two is wrong, and nobody says which
        if its_own < nats - lowered[0] * float(estimate @ g):
            rows, g, nats, cov, ratio = alone, its_g, its_nats, its_cov, its_ratio
            estimate = cov @ g
    starts = rows.frame.starts[limits.BLOCKS_S[0]]
    predicted = _predicted(rows.phi, rows.w, (rows.phi @ estimate) ** 2, starts, np.diag(sd**-2.0))
    fixed = 0.5 * float(estimate @ g)
    return Evidence(
        nats - fixed * (1.0 - 1.0 / ratio),
        np.asarray(estimate),
        np.sqrt(np.diag(cov) * ratio),
        scale,
        ratio,
        nats,
        fixed,
        float(predicted.sum()),
        float(predicted.sum() - predicted.max()),
    )


def shown_by(known: Conditional, part: Part) -> tuple[int, float]:
    """The channel in which a part explains most, and the mean square of the rows there, weighted by
    what the part would add to each."""
    rows, along = _along(known, part)
    gain = np.bincount(rows.frame.channel, along * (2.0 * rows.w - along))
    at = rows.frame.channel == int(np.argmax(gain))
    weight = along[at] ** 2
    return int(np.argmax(gain)), float(weight @ rows.w[at] ** 2 / max(float(weight.sum()), 1e-300))


def between_channels(known: Conditional, part: Part, ratio: float) -> float:
    """By how much the channels contradict one another about a part's estimate, as a factor on its
    variance (Birge, Physical Review 40 (1932), 207-227): ``ratio``, by which scores scatter
    anyhow, where chance makes as much once in a hundred."""
    rows, along = _along(known, part)
    scores, sizes = (np.bincount(rows.frame.channel, each) for each in (along * rows.w, along**2))
    shown = sizes > limits.LEAST_OWN * float(sizes.max())
    scores, sizes, left = scores[shown], sizes[shown], int(shown.sum()) - 1
    # squared sigmas off the value that all show together (Cochran's Q)
    q = float(np.sum((scores - scores.sum() / sizes.sum() * sizes) ** 2 / sizes))
    return max(ratio, q / left) if left and exceeds(q / ratio, left) < limits.SUSPECTED else ratio


def apart(known: Conditional, one: Part, other: Part) -> float:
    """Sigmas by which ``one`` part explains more than ``other`` in its place, by the scatter of the
    difference from stretch to stretch (Vuong, Econometrica 57 (1989), 307-333)."""
    gains = []
    for part in (one, other):
        rows, along = _along(known, part)
        gains.append(along * (rows.w - 0.5 * along))
    ahead, spreads = gains[0] - gains[1], []
    for starts in rows.frame.starts.values():
        sums = np.add.reduceat(ahead, starts)
        spreads.append(np.sqrt(len(sums)) * np.std(sums))
    return float(ahead.sum() / max(*spreads, 1e-300))


@dataclass(frozen=True)
class _Stacked:
    """Rows of all drives: columns ``phi`` [s, p] of a part less what is given, ``w`` [s] less what
    that explains, and of which instants they are."""

    phi: FloatArray
    w: FloatArray
    frame: Frame

    def side(self, side: Side) -> _Stacked:
        """Some of the rows."""
        at, frame = side
        return _Stacked(self.phi[at], self.w[at], frame)


def _contradicted(
    rows: _Stacked, sides: Sequence[Side], estimate: FloatArray, least_ratio: float
) -> bool:
    """Whether the receiver and the vehicle constraint say of an estimate what chance and what is
    not linear do not explain: then the vehicle slips or sways, and no sensor errs. The constraint
    has no say there. How far chance goes is told by each side's scatter about what it says itself:
    about what both say together it is the larger the more they differ."""
    slopes, variance = [], 0.0
    for side in map(rows.side, sides):
        along = side.phi @ estimate
        size = float(along @ along)
        if size <= 0.0:
            return False
        slopes.append(float(along @ side.w) / size)
        variance += max(_ratio(side, estimate), least_ratio) / size
    apart = slopes[0] - slopes[1]
    # in units of the estimate
    return apart**2 > limits.ONE_IN_A_THOUSAND**2 * (variance + limits.CHALLENGE**2)


def _ratio(rows: _Stacked, estimate: FloatArray) -> float:
    """The larger of the scatters over stretches of all lengths."""
    along = rows.phi @ estimate
    of_rows, expected = along * rows.w, along**2
    return max(_scatter(of_rows, expected, starts) for starts in rows.frame.starts.values())


def _along(known: Conditional, part: Part) -> tuple[_Stacked, FloatArray]:
    """The rows of a part, and what its estimate adds to each [s]."""
    rows = _stacked(known, part)
    sd = plain_nats(known, part)[1] * known.linear.prior_sd[list(part)]
    precision = known.info(part) + np.diag(sd**-2.0)
    return rows, rows.phi @ np.linalg.solve(precision, known.score[list(part)])


def _stacked(known: Conditional, part: Part) -> _Stacked:
    phis = []
    for rows, (others, _) in zip(known.linear.rows, known.left, strict=True):
        phi = known.linear.columns(rows, part)
        if known.given.columns:
            phi = phi - others @ known.weights[:, list(part)]
        phis.append(phi)
    w = np.concatenate([w for _, w in known.left])
    return _Stacked(np.concatenate(phis), w, known.linear.frame)


def _scatter(along: FloatArray, expected: FloatArray, starts: IntArray) -> float:
    """How much more the score along an estimate scatters between stretches that begin at rows
    ``starts`` than it should; at least one, shrunk towards it where few stretches count."""
    sums, sizes = np.add.reduceat(along, starts), np.add.reduceat(expected, starts)
    total = float(sizes.sum())
    if total <= 0.0:
        return 1.0
    slope = float(sums.sum()) / total
    ratio = float(np.sum((sums - slope * sizes) ** 2)) / total
    count = total**2 / max(float(np.sum(sizes**2)), 1e-300)
    shrink = limits.SHRINK_BLOCKS
    return max(1.0, (count * ratio + shrink) / (count + shrink))


def _predicted(
    phi: FloatArray, w: FloatArray, expected: FloatArray, starts: IntArray, precision: FloatArray
) -> FloatArray:
    """Nats [f] by which each fold is likelier with the value that the others give. Folds are
    stretches in a row, no stretch divided, of as equal information as these allow."""
    sizes = np.add.reduceat(expected, starts)
    share = (np.cumsum(sizes) - 0.5 * sizes) / max(float(sizes.sum()), 1e-300)
    fold = np.minimum((share * limits.FOLDS).astype(np.int64), limits.FOLDS - 1)
    edges = starts[np.flatnonzero(np.diff(fold, prepend=-1))]
    stops = np.append(edges[1:], len(w))
    g = np.array([phi[a:b].T @ w[a:b] for a, b in zip(edges, stops, strict=True)])
    info = np.array([phi[a:b].T @ phi[a:b] for a, b in zip(edges, stops, strict=True)])
    rest = info.sum(axis=0) - info + precision
    others = np.linalg.solve(rest, (g.sum(axis=0) - g)[..., None])[..., 0]
    own = np.einsum("fp,fpq,fq->f", others, info, others)
    return np.asarray(np.sum(others * g, axis=1) - 0.5 * own)
