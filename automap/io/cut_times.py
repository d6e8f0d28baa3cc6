"""Times of fixes that were cut, as to whole seconds where a receiver has several fixes in each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.earth import MEAN_RADIUS
from automap.records import Fixes

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
    """Fixes in log order with evenly spaced times where these were cut, and a sentence of it.

    Fixes of several receivers at one time, or rows that stand twice, keep theirs: the way from time
    to time goes on evenly through fixes that were taken one after another.
    """
    told = np.isfinite(fixes.gps_s) & np.isfinite(fixes.lat_rad) & np.isfinite(fixes.lon_rad)
    rows = np.flatnonzero(told)
    if len(rows) < 2 * _LEAST_TIMES:
        return fixes, None
    t = fixes.gps_s[rows]
    starts = np.concatenate([[0], np.flatnonzero(np.diff(t) != 0.0) + 1])
    size = np.diff(np.concatenate([starts, [len(t)]]))
    inner = size[1:-1]
    if len(inner) < _LEAST_TIMES:
        return fixes, None
    many = int(np.median(inner))
    step = float(np.median(np.diff(t[starts])))
    cut = next((value for value in _CUTS_S if abs(step - value) < _EXACT_S), None)
    if many < 2 or cut is None or np.mean(inner == many) < _USUAL_SHARE:
        return fixes, None
    off = np.abs(t / cut - np.rint(t / cut)) * cut
    if off.max() > _EXACT_S or not _goes_on_evenly(fixes, rows, starts[1:-1], many):
        return fixes, None
    place = np.arange(len(t)) - np.repeat(starts, size)
    # of the first time the early ones are missing, of others any
    place[: size[0]] += max(many - int(size[0]), 0)
    share = place / np.maximum(np.repeat(size, size), many)
    gps_s = fixes.gps_s.copy()
    gps_s[rows] = t + cut * share
    return replace(fixes, gps_s=gps_s), (
        f"times are cut to {cut:g} s, and {many} fixes share each; they are spread evenly over it, "
        "which may be wrong by as much: log times with their decimals"
    )


def _goes_on_evenly(fixes: Fixes, rows: np.ndarray, starts: np.ndarray, many: int) -> bool:
    """Whether the way between the fixes of one time is what it is between any two: of the groups of
    ``many`` that begin at ``starts`` of ``rows``."""
    lat, lon = fixes.lat_rad[rows], np.unwrap(fixes.lon_rad[rows])
    place = np.column_stack([lat, lon * np.cos(lat[0])]) * MEAN_RADIUS
    first, last, after = place[starts], place[starts + many - 1], place[starts + many]
    on = after - first
    length = np.linalg.norm(on, axis=1)
    way = float(length.sum())
    if way < _LEAST_WAY_M:
        return False
    ahead = on / np.maximum(length, 1e-9)[:, None]
    within = float(np.einsum("ij,ij->", last - first, ahead))
    return abs(many * within / way - (many - 1)) < _SHARE_OFF
