"""The adjoint back over a node whose blocks surprised, and so were trusted less."""

from __future__ import annotations

from automap.fusion.arrays import ForwardStore
from automap.jit import kernel
from automap.records import FloatArray


@kernel
def undo_surprising(
    lam: FloatArray,
    big: FloatArray,
    var: FloatArray,
    store: ForwardStore,
    first: int,
    end: int,
    most_factor: float,
    left_out: FloatArray,
    square: FloatArray,
    spread: FloatArray,
) -> None:
    """Carry ``lam`` [n] and ``big`` [n, n] back over the scalars ``first`` to ``end`` of a node
    with variances ``var`` [15] by channel, as ``undo_scalars`` does where nothing surprised.

    The slope along a scalar's variance is half of ``square`` less ``spread`` [s]. A block's NIS
    counts by 1 - m in the likelihood, where m is such that the slope along its factor is none, but
    within ``left_out`` [2]; slopes are linear in m, so two values tell it. Blocks whose factor is
    ``most_factor`` have a fixed one.
    """
    b = end
    while b > first:
        factor = store.factor[b - 1]
        a = b - 1
        # neighbours of one factor are one block, or both have none
        while a > first and store.factor[a - 1] == factor:
            a -= 1
        at = a - first
        m = 0.0
        if 1.0 < factor < most_factor:
            along = _along_factor(lam, big, var, store, a, b, 0.0, square[at:], spread[at:])
            other = _along_factor(lam, big, var, store, a, b, 1.0, square[at:], spread[at:])
            if along != other:
                m = min(max(along / (along - other), left_out[0]), left_out[1])
        _undo(lam, big, store, a, b, m, square[at:], spread[at:])
        b = a


@kernel
def _along_factor(
    lam: FloatArray,
    big: FloatArray,
    var: FloatArray,
    store: ForwardStore,
    a: int,
    b: int,
    m: float,
    square: FloatArray,
    spread: FloatArray,
) -> float:
    """The slope along the logarithm of the factor of the block ``a`` to ``b``, for ``m``."""
    _undo(lam.copy(), big.copy(), store, a, b, m, square, spread)
    total = 0.0
    for i in range(a, b):
        total += var[store.info[i, 1]] * (square[i - a] - spread[i - a])
    return float(0.5 * store.factor[a] * total)


@kernel
def _undo(
    lam: FloatArray,
    big: FloatArray,
    store: ForwardStore,
    a: int,
    b: int,
    m: float,
    square: FloatArray,
    spread: FloatArray,
) -> None:
    """Carry the adjoint over the scalars ``a`` to ``b`` whose squares count by 1 - ``m``.

    With d = nu / s, c = K' lam, w = big K over one of them, where ``lam`` is minus the slope along
    the state and ``big`` is lam lam' less twice the slope along its covariance,

        big := big - h w' - w h' + m d (h lam' + lam h')
                   + h h' (K' w + 1 / s - m d (2 c + (1 - m) d))
        lam := lam - h (c + (1 - m) d)

    which for m = 0 is the modified Bryson-Frazier smoother's.
    """
    n = lam.shape[0]
    for i in range(b - 1, a - 1, -1):
        h, gain = store.h[i], store.gain[i]
        s = store.var[i]
        d = store.nu[i] / s
        v = big @ gain
        c, kw = 0.0, 0.0
        for j in range(n):
            c += gain[j] * lam[j]
            kw += gain[j] * v[j]
        square[i - a] = c * c + 2.0 * c * d + (1.0 - m) * d * d
        spread[i - a] = kw + 1.0 / s
        half = 0.5 * (spread[i - a] - m * d * (2.0 * c + (1.0 - m) * d))
        e = c + (1.0 - m) * d
        for j in range(n):
            v[j] -= half * h[j] + m * d * lam[j]
        for j in range(n):
            lam[j] -= e * h[j]
            for q in range(n):
                big[j, q] -= h[j] * v[q] + v[j] * h[q]
