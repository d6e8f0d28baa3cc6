"""From innovations to rows that are white, of size one, and not ruled by outliers.

A filter whose noise model is not quite right leaves innovations that resemble their
neighbours and have long tails; a score computed from them would be too sure. Each channel is
scaled by its robust spread, its remaining autocorrelation is taken out by a short
autoregression (generalised least squares after Cochrane and Orcutt, 1949), and large values
count less (Huber's psi). Sensitivities pass through the same steps, so nothing is biased.

What counts as large is judged by what is left over once everything that may be missing has been
fitted: an innovation that a missing effect makes large is no wild value.

A receiver errs more in some stretches than in others: in bends that its filter smooths, between
houses. Rows of such a stretch count for as little as its own scatter says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automap.fusion.layout import CH_NHC, CH_ODOMETER, CH_POS, CH_VEL, MAX_SCALARS
from automap.gap.kernels import whiten_columns
from automap.gap.limits import AR_ORDER, BLOCKS_S, HUBER, LEAST_OWN, MAX_COEFFICIENT_SUM, MIN_ROWS
from automap.gap.rows import STRETCH, Rows, pieces, times
from automap.gates import sd_by_median
from automap.records import FloatArray, IntArray

CLIPPED_SIZE = 0.9205
"""Mean square of a standard normal value clipped at ``HUBER``: 1 - 2 (a phi(a) - (a^2 - 1) Q(a)).
Channels that are quieter, as a loose vehicle constraint is, are not scaled up to it."""
MIN_SPREAD = (0.7,) * CH_NHC + (1.0,) * (CH_ODOMETER - CH_NHC) + (0.7,)
"""No channel counts for much more than its noise model says; pseudo-measurements for no more at
all."""
LOOSE = (CH_NHC, CH_NHC + 1)
"""Channels of the vehicle constraint: how a vehicle sways is no noise whose memory to take out, it
is what the constraint's own sigma stands for."""
RECEIVER = tuple(tuple(range(first, first + 3)) for first in (CH_POS, CH_VEL))
"""Channels whose noise grows and falls together along a drive: of positions, of velocities."""
FREEDOM = 2.0 ** np.arange(1, 15)
"""Degrees of freedom from which that of a stretch's scatter is chosen; the last are as normal."""
SCATTER_ROUNDS = 8
"""What is clipped and what is scatter have settled then."""
PASSES = 3
"""Of weights that the residuals decide: they have settled then."""


@dataclass(frozen=True)
class Whitener:
    """Per channel: spread and autoregression [p]."""

    spread: dict[int, float]
    ar: dict[int, FloatArray]


def fit_whitener(whitened: FloatArray, channel: IntArray) -> Whitener:
    """Spread and autoregression of each channel's whitened innovations [s]."""
    spread: dict[int, float] = {}
    ar: dict[int, FloatArray] = {}
    for c in range(MAX_SCALARS):
        w = whitened[channel == c]
        if len(w) < MIN_ROWS:
            continue
        scale = max(sd_by_median(w - np.median(w)), 1e-3)
        clipped = np.clip(w / scale, -3.0, 3.0)
        ar[c] = np.zeros(AR_ORDER) if c in LOOSE else autoregression(clipped)
        rest = filtered(w[:, None], ar[c])[:, 0]
        spread[c] = max(sd_by_median(rest), MIN_SPREAD[c])
    return Whitener(spread, ar)


def autoregression(w: FloatArray) -> FloatArray:
    """Yule-Walker coefficients [p], shrunk where they are within their error."""
    n = len(w)
    r = np.array([np.dot(w[k:], w[: n - k]) / n for k in range(AR_ORDER + 1)])
    if r[0] <= 0.0:
        return np.zeros(AR_ORDER)
    from scipy.linalg import solve_toeplitz

    a = np.asarray(solve_toeplitz(r[:-1] + 1e-6 * r[0] * np.eye(1, AR_ORDER)[0], r[1:]))
    a[np.abs(a) < 2.0 / np.sqrt(n)] = 0.0
    total = float(np.abs(a).sum())
    return a * min(1.0, MAX_COEFFICIENT_SUM / total) if total > 0.0 else a


def filtered(rows: FloatArray, a: FloatArray) -> FloatArray:
    """Rows [m, c] less their prediction from the rows before."""
    out = rows.copy()
    for k, value in enumerate(a, start=1):
        if value != 0.0:
            out[k:] -= value * rows[:-k]
    return out


def white_rows(
    whitener: Whitener,
    whitened: FloatArray,
    phi: FloatArray,
    t: FloatArray,
    channel: IntArray,
    left: FloatArray,
) -> Rows:
    """Apply a whitener to innovations [s] and sensitivities [s, c], in place; ``left`` [s] what is
    left of the innovations decides how much each row counts."""
    rows = np.flatnonzero(np.isin(channel, list(whitener.spread)))
    w, rest = np.zeros((2, len(channel)))
    for c, spread in whitener.spread.items():
        at = np.flatnonzero(channel == c)
        rest[at] = filtered(left[at, None], whitener.ar[c])[:, 0] / spread
    noisier, factor = np.ones((2, len(channel)))
    before = np.full((len(channel), AR_ORDER), -1)
    ar = np.zeros((MAX_SCALARS, AR_ORDER))
    for channels in RECEIVER:
        at = np.flatnonzero(np.isin(channel, [c for c in channels if c in whitener.spread]))
        noisier[at] = stretch_scatter(rest[at], t[at])
    for c, spread in whitener.spread.items():
        at = np.flatnonzero(channel == c)
        u, sizes = rest[at] / noisier[at], spread * noisier[at]
        weight = HUBER / np.maximum(np.abs(u), HUBER)
        size = float(np.mean((weight * u) ** 2))
        # a score of variance size * phi' phi, an information of mean(weight) * phi' phi
        even = float(weight.mean()) / max(size, CLIPPED_SIZE)
        factor[at], ar[c] = np.sqrt(weight * even) / sizes, whitener.ar[c]
        w[at] = factor[at] * filtered(whitened[at, None], whitener.ar[c])[:, 0]
        for k in range(1, AR_ORDER + 1):
            before[at[k:], k - 1] = at[:-k]
    whiten_columns(phi, rows, before, ar[channel], factor)
    return Rows(w[rows], phi[: len(rows)], t[rows], channel[rows])


def stretch_scatter(u: FloatArray, t: FloatArray) -> FloatArray:
    """By how much rows ``u`` [s], of size one as a rule, scatter more in the stretch [s] that they
    are of, by their times ``t`` [s] in s; at least one.

    The variances of stretches are taken for draws from an inverse gamma distribution: together the
    rows of one follow Student's t (Lange, Little and Taylor, JASA 84 (1989), 881-896), of as many
    degrees of freedom as makes all likeliest. Single wild values are no scatter.
    """
    if len(u) == 0:
        return np.ones(0)
    _, stretch = np.unique(((t - t.min()) / BLOCKS_S[0]).astype(np.int64), return_inverse=True)
    count = np.bincount(stretch).astype(np.float64)
    variance = np.ones(len(count))
    for _ in range(SCATTER_ROUNDS):
        most = HUBER * np.sqrt(variance)[stretch]
        squares = np.bincount(stretch, np.clip(u, -most, most) ** 2) / CLIPPED_SIZE
        freedom = _likeliest_freedom(squares, count)
        variance = (freedom + squares) / (freedom + count)
    return np.asarray(np.sqrt(np.maximum(variance, 1.0))[stretch])


def _likeliest_freedom(squares: FloatArray, count: FloatArray) -> float:
    """Degrees of freedom under which sums of squares [b] of ``count`` [b] rows are likeliest."""
    from scipy.special import gammaln

    nu = FREEDOM[:, None]
    nats = gammaln(0.5 * (nu + count)) - gammaln(0.5 * nu) - 0.5 * count * np.log(nu)
    nats -= 0.5 * (nu + count) * np.log1p(squares / nu)
    return float(FREEDOM[int(np.argmax(nats.sum(axis=1)))])


def whitened_rows(
    raw: Sequence[Rows], known: FloatArray, sds: FloatArray, may_act: bool = True
) -> tuple[Rows, ...]:
    """White rows in the place of raw ones, weighted by what is left of them once all candidates
    together have been fitted (ridge regression by their priors, iteratively reweighted: Huber,
    Robust Statistics, 1981).

    Innovations that only a missing effect makes large would else count for too little, and a
    formula that saturates as the weights do would explain them best. Where no more may act than
    what is ``known``, rows count by what that leaves: weights that so many candidates have settled
    favour what they say.
    """
    left = [r.w - times(r.phi, known) for r in raw]
    values = np.zeros(len(sds))
    inverse: FloatArray | None = None
    for number in range(PASSES if may_act else 0):
        roots = [_root_weights(rest, r.channel) for r, rest in zip(raw, left, strict=True)]
        if number != 1 or inverse is None:
            inverse, values = _ridge(raw, roots, sds)
        else:
            # by the weights of before, whose matrix is nearly that of these (Huber, section 7.8)
            slope = -values * sds**-2.0
            for r, root in zip(raw, roots, strict=True):
                slope += _transposed(r.phi, root**2 * (r.w - times(r.phi, values)))
            values = values + inverse.T @ (inverse @ slope)
        left = [r.w - times(r.phi, values) for r in raw]
        if number == PASSES - 1:
            left = [_studentised(*each, inverse) for each in zip(left, raw, roots, strict=True)]
    out = []
    for r, rest in zip(raw, left, strict=True):
        whitener = fit_whitener(rest, r.channel)
        out.append(white_rows(whitener, r.w, r.phi, r.t, r.channel, rest))
    return tuple(out)


def _ridge(
    raw: Sequence[Rows], roots: Sequence[FloatArray], sds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Values [c] that fit rows of weights ``roots``^2 under priors of ``sds`` [c], and the inverse
    of the Cholesky factor of their information [c, c]."""
    from scipy.linalg import solve_triangular

    score: FloatArray = np.zeros(len(sds))
    for r, root in zip(raw, roots, strict=True):
        score += _transposed(r.phi, root**2 * r.w)
    try:
        factor, unit = _factor(raw, roots, sds, np.float32)
    except np.linalg.LinAlgError:
        # a drive that stands tells many candidates apart by priors alone, which rounding hides
        factor, unit = _factor(raw, roots, sds, np.float64)
    inverse = solve_triangular(factor, np.diag(unit), lower=True, overwrite_b=True)
    return np.asarray(inverse), np.asarray(inverse.T @ (inverse @ score))


def _factor(
    raw: Sequence[Rows],
    roots: Sequence[FloatArray],
    sds: FloatArray,
    precision: type[np.float32] | type[np.float64],
) -> tuple[FloatArray, FloatArray]:
    """Cholesky factor [c, c] of the information of rows in units [c] that make its diagonal one."""
    info: FloatArray = np.diag(sds**-2.0)
    for r, root in zip(raw, roots, strict=True):
        for part, used, f in pieces(r.phi, precision):
            f *= root[part, None].astype(precision)
            info[np.ix_(used, used)] += f.T @ f
    # parameters have sizes of many orders
    unit = 1.0 / np.sqrt(np.diag(info))
    return np.asarray(np.linalg.cholesky(info * np.outer(unit, unit)), np.float64), unit


def _studentised(left: FloatArray, rows: Rows, root: FloatArray, inverse: FloatArray) -> FloatArray:
    """What is left [s] of rows of weights ``root``^2 after a fit whose information's factor has the
    ``inverse`` [c, c], as large as the noise in them is: a fit follows the rows that tell most, and
    leaves little of them (Cook and Weisberg, Residuals and Influence in Regression, 1982, section
    2.2)."""
    out = np.empty_like(left)
    across = inverse.T.astype(np.float32)
    for part, used, f in pieces(rows.phi, np.float32):
        f *= root[part, None].astype(np.float32)
        fitted = f @ across[used]
        leverage = np.einsum("sc,sc->s", fitted, fitted)
        out[part] = left[part] / np.sqrt(np.maximum(1.0 - leverage, LEAST_OWN))
    return out


def _transposed(phi: FloatArray, values: FloatArray) -> FloatArray:
    """phi' times values [c] in double precision, a stretch at a time."""
    out = np.zeros(phi.shape[1])
    for start in range(0, len(values), STRETCH):
        part = slice(start, start + STRETCH)
        out += phi[part].T.astype(np.float64) @ values[part]
    return out


def _root_weights(left: FloatArray, channel: IntArray) -> FloatArray:
    """Square roots [s] of the weights of rows by what is left of them."""
    out = np.zeros(len(left))
    for c in np.unique(channel):
        at = channel == c
        spread = max(sd_by_median(left[at]), MIN_SPREAD[c])
        out[at] = np.sqrt(HUBER / np.maximum(np.abs(left[at]) / spread, HUBER)) / spread
    return out
