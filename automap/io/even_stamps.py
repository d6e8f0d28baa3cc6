"""Stamps that come in bursts: of a computer that reads several samples at once.

The sensor's own clock runs at a constant rate, and a sample is stamped when it is read: never too
early, and late by as long as it lay in a buffer. So the stamps less the sensor's time have a lower
edge, which samples touch that were read at once. Where samples are lost the edge rises for good.
Stamps that were cut off, as to whole seconds, are too early by up to what was cut.
"""

from __future__ import annotations

import numpy as np

from automap.records import FloatArray, IntArray

_CLOSE = 0.25
"""A step of so much of the usual one is none that a sensor makes."""
_BURSTY_SHARE = 0.1
"""Of steps that are so close. Reading pairs makes half of them so, and a buffer that is read every
16 ms a third at 100 Hz; recordings by a sensor's own clock, with late packets, show up to 5 %."""
_COPIES_SHARE = 0.9
"""Rows that repeat stamp and readings are copies where nearly all that repeat a stamp do."""
_STEPS = 1024
"""The usual step is that of so many together, many bursts."""
_EDGE_S = 10.0
"""A sample is read at once in any stretch as long; a buffer overflows before."""
_RATE_S = 2.0
"""The rate is the median of what the edge shows over stretches of so much."""
_DECIMAL = (1_000_000_000, 100_000_000, 10_000_000)
"""What times are written to, ns; a burst has as round a step by chance alone."""
_SAME_NS = 1000
"""Seconds since 1970 as a float are good to a quarter of that."""
_ROUNDS = 3
"""The rate is told by the edge, and the edge with the rate: the second has settled."""


def straight_stamps(t_ns: IntArray, readings: FloatArray) -> IntArray | None:
    """Stamps [n] of a constant rate in place of bursts; None where the stamps are even already.

    ``t_ns`` [n] does not decrease; ``readings`` [n, k] tell samples read together, whose stamps
    may be equal, from copies of a row. The result strictly increases and bears the least delay.
    """
    n = len(t_ns)
    block = min(_STEPS, n // 4)
    if block < 16:
        return None
    since = np.asarray(t_ns - t_ns[0], dtype=np.float64) * 1e-9
    steps = np.diff(since)
    usual = float(np.median(since[block:] - since[:-block])) / block
    if (steps < 0.0).any() or not np.mean(steps < _CLOSE * usual) >= _BURSTY_SHARE:
        return None
    equal = steps == 0.0
    copies = equal & (readings[1:] == readings[:-1]).all(axis=1)
    if copies.sum() > _COPIES_SHARE * max(equal.sum(), 1):
        return None
    count = np.arange(n)
    for _ in range(_ROUNDS):
        edge = _lower_edge(since - usual * count, usual)
        # short, so that few of them hold a loss
        reach = min(max(round(_RATE_S / usual), block), n - 1)
        usual += float(np.median(edge[reach:] - edge[:-reach])) / reach
    late = since - usual * count
    even = usual * count + _lower_edge(late, usual)
    cut = cut_to_ns(t_ns)
    if cut:
        # anywhere between the earliest line that the stamps allow and the latest
        even = usual * count + 0.5 * (_lower_edge(late, usual) - _lower_edge(-late, usual))
        even += 0.5e-9 * cut
    out = t_ns[0] + np.asarray(np.rint(even * 1e9), dtype=np.int64)
    # a clock that was set back, or no constant rate
    return out if (np.diff(out) > 0).all() else None


def cut_to_ns(t_ns: IntArray) -> int:
    """The decimal step that stamps [n] were cut to: each is a whole number of it, and most go on
    by one; 0 where there is none."""
    steps = np.diff(t_ns)
    steps = steps[steps > _SAME_NS]
    usual = float(np.median(steps)) if len(steps) else 0.0
    cut = next((step for step in _DECIMAL if abs(usual - step) <= _SAME_NS), 0)
    off = (t_ns + _SAME_NS) % cut if cut else np.zeros(0, np.int64)
    return cut if (off <= 2 * _SAME_NS).all() else 0


def bursts_text(rate_hz: float, t_ns: IntArray) -> str:
    """What was done about bursts of stamps [n], for a warning."""
    cut = cut_to_ns(t_ns)
    if cut:
        return (
            f"stamps are written to {1e-9 * cut:g} s and shared by several samples; they are taken "
            f"from a constant {rate_hz:.4g} Hz between them"
        )
    return (
        "stamps come in bursts, as of a computer that reads several samples at once; they are "
        f"taken from a constant {rate_hz:.4g} Hz under them, and a delay that all have stays"
    )


def _lower_edge(late: FloatArray, step_s: float) -> FloatArray:
    """The lower edge [n] of delays [n]: peaks are cut off, a rise for good is not.

    The opening by a flat structuring element that lies within the data (J. Serra, Image Analysis
    and Mathematical Morphology, 1982, chapter XII).
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    width = (min(round(_EDGE_S / step_s), len(late)) - 1) // 2 * 2 + 1
    lowest = minimum_filter1d(late, width, mode="constant", cval=-np.inf)
    return np.asarray(maximum_filter1d(lowest, width, mode="constant", cval=-np.inf))
