"""Things that stay at their place in the picture while the vehicle drives: a sticker on the
windscreen, a mark on the lens, what the dashboard mirrors.

A sign is seen from no further than ``SEEN_FROM_M``, so that a vehicle that has driven as far has
passed it. Boxes of one place and size in most frames of so long a way are of no sign by the road,
whatever path, camera and tracks say; nothing is fitted to them. A row of signs, such as chevrons
on the outside of a bend, can fill one place for as long; but each of these grows as it comes near,
so that larger boxes are in as many frames.
"""

from __future__ import annotations

import numpy as np

from automap.effects.limits import MOVING_SPEED
from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.views import MeasurementNoise
from automap.interpolation import LONGEST_GAP_S
from automap.records import BoolArray, Detections, FloatArray, IntArray, Trajectory

_CELL_SD, _CELL_LOG_HEIGHT = 4.0, 0.5
"""Cells in which places are looked for, in sigmas of a centre and in logarithms of the height, some
four of its sigmas: what lies on a corner fills eight of them, one by an eighth at least."""
_PARTS = 8
"""So many: what is asked of a thing is asked of a cell to an eighth."""


def fixed_boxes(trajectory: Trajectory, found: Detections, noise: MeasurementNoise) -> BoolArray:
    """Which boxes [n] of one camera are of things that stay at their place in the picture, within
    what boxes err by (``noise``), for more than ``SEEN_FROM_M`` driven."""
    fixed = np.zeros(len(found), np.bool_)
    box = np.asarray(found.box, np.float64).reshape(-1, 4)
    middle, extent = 0.5 * (box[:, :2] + box[:, 2:]), box[:, 3] - box[:, 1]
    rows = np.flatnonzero(np.isfinite(box).all(axis=1) & (extent > 0.0))
    if not len(rows) or not len(trajectory.t_ns):
        return fixed
    place = np.column_stack([middle[rows], extent[rows]])
    number = np.unique(found.frame[rows], return_inverse=True)[1].ravel()
    driven = driven_m(trajectory, np.asarray(found.t_ns, np.int64)[rows])
    sd = np.hypot(noise.pixel_sd, noise.box_fraction * place[:, 2])
    across = np.argsort(place[:, 0], kind="stable")
    x = place[across, 0]
    most_square = gate(limits.FIXED_PROBABILITY, 3)
    for thing in _suspects(place, sd, number, driven):
        its_sd = np.hypot(noise.pixel_sd, noise.box_fraction * thing[2])
        reach = np.sqrt(most_square) * its_sd
        ends = np.searchsorted(x, [thing[0] - reach, thing[0] + reach])
        near = across[slice(*ends)]
        # a height is of two sides
        off = (place[near] - thing) / (its_sd * np.array([1.0, 1.0, np.sqrt(2.0)]))
        square = np.sum(off**2, axis=1)
        kept = np.flatnonzero(square < most_square)
        kept = kept[np.argsort(number[near[kept]], kind="stable")]
        near, square = near[kept], square[kept]
        gaps = np.flatnonzero(np.diff(number[near]) > limits.FIXED_MISSED)
        edges = np.concatenate([[0], gaps + 1, [len(near)]])
        way = driven[near[edges[1:] - 1]] - driven[near[edges[:-1]]] if len(near) else np.zeros(0)
        for k in np.flatnonzero(way > limits.SEEN_FROM_M):
            part = slice(edges[k], edges[k + 1])
            run = near[part]
            frames = np.unique(number[run])
            if len(frames) < limits.FIXED_VIEWS:
                continue
            # of signs some are between one and a half and three times as large
            grown = (place[:, 2] > 1.5 * thing[2]) & (place[:, 2] < 3.0 * thing[2])
            grown &= (number >= frames[0]) & (number <= frames[-1])
            most = 2 * len(frames) > frames[-1] - frames[0] + 1
            alone = limits.FIXED_ALONE * len(np.unique(number[grown])) < len(frames)
            # the mean of what three errors scatter by
            if most and alone and square[part].mean() < 3.0:
                fixed[rows[run]] = True
    return fixed


def _suspects(
    place: FloatArray, sd: FloatArray, number: IntArray, driven: FloatArray
) -> list[FloatArray]:
    """Middles and heights [3] in the picture near which a thing may be that stays there, by the
    boxes' ``place`` [n, 3], ``sd`` [n], ``number`` [n] of their frames and way ``driven`` [n]."""
    size = np.round(np.log(place[:, 2]) / _CELL_LOG_HEIGHT)
    usual = np.array([np.median(sd[size == one]) for one in np.unique(size)])
    wide = _CELL_SD * usual[np.searchsorted(np.unique(size), size)]
    cells = np.column_stack([size, np.round(place[:, :2] / wide[:, None])]).astype(np.int64)
    cell = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
    order = np.lexsort([number, cell])
    apart = np.diff(number[order]) > _PARTS * limits.FIXED_MISSED
    runs = np.split(order, np.flatnonzero(apart | (np.diff(cell[order]) != 0)) + 1)
    return [
        np.median(place[run], axis=0)
        for run in runs
        if len(run) >= limits.CARRIER_VIEWS
        and np.ptp(driven[run]) > limits.SEEN_FROM_M / _PARTS
        and _PARTS * len(run) > np.ptp(number[run]) / 2
    ]


def driven_m(trajectory: Trajectory, t_ns: IntArray) -> FloatArray:
    """Metres [n] driven until the stamps ``t_ns`` [n]; at rest a path wanders, and what came in a
    gap nobody knows: neither is a way."""
    speed = np.linalg.norm(trajectory.vel_ned, axis=1)
    seconds = np.diff(trajectory.t_ns, prepend=trajectory.t_ns[:1]) * 1e-9
    known = (speed > MOVING_SPEED) & (seconds <= LONGEST_GAP_S)
    driven = np.cumsum(np.where(known, speed * seconds, 0.0))
    since = (trajectory.t_ns - trajectory.t_ns[0]) * 1.0
    return np.asarray(np.interp((t_ns - trajectory.t_ns[0]) * 1.0, since, driven))
