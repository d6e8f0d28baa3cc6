"""Times of fixes that were cut, as to whole seconds where a receiver has several fixes in each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.earth import MEAN_RADIUS
from automap.records import Fixes, FloatArray, IntArray

_CUTS_S = (1.0, 0.1)
"""What programs write times to, s."""
_EXACT_S = 1e-5
"""Seconds since 1980 as a float are good to a hundredth of that."""
_USUAL_SHARE = 0.9
"""Of the times have as many fixes as the receiver's rate gives. Chosen: some rows are lost."""
_LEAST_TIMES = 10
"""Fewer times tell no rate."""
_LEAST_WAY_M = 100.0
"""Within less way the errors of fixes hide how it is shared out."""
_SHARE_OFF = 0.25
"""The way between the fixes of one time, in ways between fixes, may be so much another. Chosen: of
several receivers at one time it is no way at all, or one of each time's own."""


def uncut_times(fixes: Fixes) -> tuple[Fixes, str | None]:
    """Fixes in log order with evenly spaced times where these were cut, and a sentence of it."""
    told = np.isfinite(fixes.gps_s) & np.isfinite(fixes.lat_rad) & np.isfinite(fixes.lon_rad)
    rows = np.flatnonzero(told)
    found = uncut(fixes.gps_s[rows], fixes.lat_rad[rows], fixes.lon_rad[rows])
    if found is None:
        return fixes, None
    gps_s = fixes.gps_s.copy()
    gps_s[rows] = found[0]
    return replace(fixes, gps_s=gps_s), found[1]


def uncut_stamps(
    t_ns: IntArray, lat_rad: FloatArray, lon_rad: FloatArray
) -> tuple[IntArray, list[str]]:
    """As ``uncut_times``, of the stamps [n] of a table's rows."""
    rows = np.flatnonzero(np.isfinite(lat_rad) & np.isfinite(lon_rad))
    whole = int(t_ns[0]) // 10**9 * 10**9 if len(t_ns) else 0
    found = uncut(np.asarray((t_ns[rows] - whole) * 1e-9), lat_rad[rows], lon_rad[rows])
    if found is None:
        return t_ns, []
    spread = t_ns.copy()
    spread[rows] = whole + np.rint(found[0] * 1e9).astype(np.int64)
    return spread, [found[1]]


def uncut(t: FloatArray, lat_rad: FloatArray, lon_rad: FloatArray) -> tuple[FloatArray, str] | None:
    """Evenly spaced times [n] for ones ``t`` [n] s that were cut, and a sentence that says so; None
    where they were not.

    Fixes of several receivers at one time, or rows that stand twice, keep theirs: the way from time
    to time goes on evenly through fixes that were taken one after another.
    """
    if len(t) < 2 * _LEAST_TIMES:
        return None
    starts = np.concatenate([[0], np.flatnonzero(np.diff(t) != 0.0) + 1])
    size = np.diff(np.concatenate([starts, [len(t)]]))
    inner = size[1:-1]
    if len(inner) < _LEAST_TIMES:
        return None
    many = int(np.median(inner))
    step = float(np.median(np.diff(t[starts])))
    cut = next((value for value in _CUTS_S if abs(step - value) < _EXACT_S), None)
    if many < 2 or cut is None or np.mean(inner == many) < _USUAL_SHARE:
        return None
    off = np.abs(t / cut - np.rint(t / cut)) * cut
    full = starts[1:-1][inner == many]
    if off.max() > _EXACT_S or not _goes_on_evenly(lat_rad, lon_rad, full, many):
        return None
    place = np.arange(len(t)) - np.repeat(starts, size)
    # of the first time the early ones are missing, of others any
    place[: size[0]] += max(many - int(size[0]), 0)
    share = place / np.maximum(np.repeat(size, size), many)
    return t + cut * share, (
        f"times are cut to {cut:g} s, and {many} fixes share each; they are spread evenly over it, "
        "which may be wrong by as much: log times with their decimals"
    )


def _goes_on_evenly(lat_rad: FloatArray, lon_rad: FloatArray, starts: IntArray, many: int) -> bool:
    """Whether the way between the fixes of one time is what it is between any two, of the groups of
    ``many`` that begin at ``starts`` and are followed by another."""
    lon = np.unwrap(lon_rad) * np.cos(lat_rad[0])
    place = np.column_stack([lat_rad, lon]) * MEAN_RADIUS
    first, last, after = place[starts], place[starts + many - 1], place[starts + many]
    on = after - first
    length = np.linalg.norm(on, axis=1)
    way = float(length.sum())
    # what is no number is no way
    if not way >= _LEAST_WAY_M:
        return False
    ahead = on / np.maximum(length, 1e-9)[:, None]
    within = float(np.einsum("ij,ij->", last - first, ahead))
    return abs(many * within / way - (many - 1)) < _SHARE_OFF
