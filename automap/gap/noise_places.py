"""Where on a drive noise is larger than stated: everywhere, or in one place.

A sensor that is noisier than its data sheet is so all along. What a single event makes of a sensor,
a mount that slips or a zero that settles, is taken up by a level of noise as well, but shows in one
stretch alone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from automap.fusion.kernel_runs import run_forward
from automap.fusion.layout import CHANNELS
from automap.gap import limits
from automap.gap.fit import Fit
from automap.gap.misfit import CLIP, LEAST_ROWS, MEASURED, Misfit
from automap.gap.noise import at_levels
from automap.gates import sd_by_median
from automap.records import FloatArray, IntArray

LEAST_STRETCHES = 12
"""Of fewer the usual scatter is not known to a third of itself."""


def noise_places(
    fits: Sequence[Fit], levels: Collection[str], stated: Mapping[str, float]
) -> tuple[Misfit, ...]:
    """Stretches in which levels of noise are needed that are more than ``stated``, and are not
    needed as much elsewhere: the place that stands out most for each level, the largest first.

    Under the stated level the mean squares of innovations are compared from stretch to stretch. If
    the noise is larger all along they follow one gamma distribution, of shape by their own median
    and median deviation.
    """
    found = [one for level in levels for one in _of_level(fits, level, stated[level])]
    return tuple(sorted(set(found), key=lambda m: -m.size))


def _of_level(fits: Sequence[Fit], level: str, stated: float) -> list[Misfit]:
    best: Misfit | None = None
    for fit in fits:
        moved = {level: stated / fit.model.factors[level]}
        problem, nodes, path = at_levels(fit, moved, len(fit.last.nodes.t))
        run = run_forward(problem, nodes, fit.start, fit.last.shift, linearised_at=path)
        store = run.store
        t = nodes.t[store.info[:, 0]]
        width = limits.BLOCKS_S[0]
        number = (t / width).astype(np.int64)
        for channel in range(MEASURED):
            at = store.info[:, 1] == channel
            if at.sum() < LEAST_ROWS:
                continue
            squares = np.minimum(store.nu[at] ** 2 / store.var[at], CLIP**2)
            count = np.bincount(number[at])
            known = np.flatnonzero(count)
            sizes = np.bincount(number[at], squares)[known] / count[known]
            one = _standing_out(sizes, known, width, CHANNELS[channel], fit.opened.drive.begin_s)
            if one is not None and (best is None or one.p_value < best.p_value):
                best = one
    return [best] if best is not None else []


def _standing_out(
    sizes: FloatArray, number: IntArray, width: float, channel: str, begin_s: float
) -> Misfit | None:
    """The stretch whose mean square ``sizes`` [k] is larger than all others make likely, with its
    neighbours that are too; None where there is none."""
    from scipy.special import gammaincc

    if len(sizes) < LEAST_STRETCHES:
        return None
    usual = float(np.median(sizes))
    spread = sd_by_median(sizes - usual)
    if usual <= 0.0 or spread <= 0.0:
        return None
    shape = (usual / spread) ** 2
    # of all stretches and channels it is the largest
    p = np.minimum(1.0, MEASURED * len(sizes) * gammaincc(shape, shape * sizes / usual))
    top = first = last = int(np.argmax(sizes))
    if p[top] > np.exp(-limits.LEAST_ODDS):
        return None
    while first > 0 and p[first - 1] < 1.0:
        first -= 1
    while last + 1 < len(p) and p[last + 1] < 1.0:
        last += 1
    low, high = (begin_s + width * x for x in (number[first], number[last] + 1))
    where = f"{low:.3g} to {high:.3g} s after the start"
    return Misfit(channel, "time", where, float(sizes[first : last + 1].mean()), float(p[top]))
