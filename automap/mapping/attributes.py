"""What a map sign inherits from its sightings: class, times, size and the rest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.jit import kernel
from automap.mapping.association import Members
from automap.mapping.limits import ALTERNATIVES, CHANGED, CLASS_RIGHT, FACING_SD, LEAST_CONFIDENCE
from automap.mapping.sightings import Sightings, Told
from automap.mapping.sureness import class_probabilities, group_probabilities
from automap.records import BoolArray, FloatArray, IntArray

REJECTED = "rejected"
_STANDING = {"accepted", "corrected", "added"}
"""What reviewers of a drive make of a sign's status."""
_FALSE_SHARE = (1.0 - CLASS_RIGHT) / ALTERNATIVES


@dataclass(frozen=True, kw_only=True)
class Attributes(Told):
    """Columns [m] of map signs; ``class_share`` the part of the sightings' belief that is for
    the class, ``drives`` the numbers of those that saw it, ``confidence`` that any sighting is
    right; ``class_probability`` and ``group_probability`` by all drives that tell them, since a
    change only those after it (NaN: none does); ``existence`` and what is by size are told later.
    """

    code: IntArray
    class_share: FloatArray
    facing_rad: FloatArray
    drives: list[tuple[int, ...]]


def combine_attributes(sightings: Sightings, sign: IntArray) -> Attributes:
    """Attributes of the map signs that the sightings were given to."""
    m = int(sign.max()) + 1 if len(sign) else 0
    members = Members(sign)
    order, edges = members.order, members.edges
    spans = list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    views = sightings.n_views
    weight = np.maximum(views, 1).astype(np.float64)
    doubt = 1.0 - np.clip(sightings.confidence, 0.0, 0.999)
    code, share, before = _classes(sightings, sign, order, edges)
    # what was read before a sign became another one tells nothing of what it is
    holds = np.where(before, -1, sign)
    facing = sightings.facing
    known = np.isfinite(facing)
    facing_sd = sightings.facing_sd_rad
    sure = np.where(known, 1.0 / np.nan_to_num(facing_sd, nan=FACING_SD) ** 2, 0.0)
    north = np.bincount(sign, sure * np.cos(np.nan_to_num(facing)), m)
    east = np.bincount(sign, sure * np.sin(np.nan_to_num(facing)), m)
    direction = np.where(np.hypot(north, east) > 1e-9, np.arctan2(east, north), np.nan)
    sides, states, size = sightings.side, sightings.status, sightings.size_m
    side = _texts(_most(sides[order[a:b]], weight[order[a:b]]) for a, b in spans)
    looked, behind = np.nan_to_num(sightings.n_looked), np.nan_to_num(sightings.n_back_views)
    # each drive has a light of its own, so each counts alike; the scatter is within and between
    one = np.ones(len(sign))
    contrast = _mean(sign, sightings.contrast, one, m)
    square = _mean(sign, sightings.contrast**2 + sightings.contrast_sd**2, one, m)
    notes = sightings.contrast_note[order]
    seen_by = sightings.drive[order]
    return Attributes(
        code=code,
        class_share=share,
        n_views=np.bincount(sign, views, m).astype(np.int64),
        first_gps_s=np.fmin.reduceat(sightings.first_gps_s[order], edges[:-1]),
        last_gps_s=np.fmax.reduceat(sightings.last_gps_s[order], edges[:-1]),
        height_above_road_m=_mean(sign, sightings.height_above_road_m, 1.0 / sightings.own_u, m),
        # what is wrong of a vehicle's height all its drives have in common
        sd_above_road_m=np.sqrt(
            _mean(sign, sightings.sd_above_road_m**2, 1.0 / sightings.own_u, m)
        ),
        facing_rad=np.mod(direction, 2.0 * np.pi),
        # what the road's direction lends all drives have in common
        facing_sd_rad=np.sqrt(_mean(sign, facing_sd**2, sure, m)),
        size_m=np.exp(_mean(sign, np.log(np.where(size > 0.0, size, np.nan)), weight, m)),
        side=side,
        # drives go in lanes of their own: as far aside as those that saw it on that side
        path_offset_m=_mean(
            sign, np.where(sides == side[sign], sightings.path_offset_m, np.nan), weight, m
        ),
        status=_texts(_status(states[order[a:b]], seen_by[a:b]) for a, b in spans),
        drives=[tuple(sorted(set(seen_by[a:b].tolist()))) for a, b in spans],
        confidence=1.0 - np.exp(np.bincount(sign, np.log(doubt), m)),
        class_probability=class_probabilities(
            sightings.code, sightings.class_probability, holds, code
        ),
        group_probability=group_probabilities(
            *(sightings.code, sightings.classes, sightings.group_probability, holds, code)
        ),
        contrast=contrast,
        contrast_sd=np.sqrt(np.maximum(square - contrast**2, 0.0)),
        contrast_note=_texts(
            "" if np.isfinite(value) else _most(notes[a:b], weight[order[a:b]])
            for value, (a, b) in zip(contrast.tolist(), spans, strict=True)
        ),
        seen_share=_mean(sign, sightings.seen_share, looked, m),
        n_looked=np.rint(np.bincount(sign, looked, m)),
        n_back_views=np.rint(np.bincount(sign, behind, m)),
    )


def _texts(values: Iterable[str]) -> npt.NDArray[np.object_]:
    return np.array([*values], np.object_)


def _mean(sign: IntArray, values: FloatArray, weight: FloatArray, m: int) -> FloatArray:
    known = np.isfinite(values)
    w = np.where(known, weight, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(
            np.bincount(sign, w * np.where(known, values, 0.0), m) / np.bincount(sign, w, m)
        )


def _most(values: npt.NDArray[np.generic], weight: FloatArray) -> str:
    total: dict[str, float] = {}
    for value, w in zip(values.tolist(), weight.tolist(), strict=True):
        if value:
            total[str(value)] = total.get(str(value), 0.0) + w
    return max(sorted(total), key=total.__getitem__) if total else ""


def _status(states: npt.NDArray[np.generic], drives: IntArray) -> str:
    """Passes of several drives make up for what was weak in one, unless all call it odd; what the
    reviewer of one drive rejected is no sign in others, unless another reviewer thought so."""
    texts = [str(s) for s in states.tolist()]
    if REJECTED in texts:
        return next((text for text in texts if text in _STANDING), REJECTED)
    if "ok" in texts:
        return "ok"
    if len(set(drives.tolist())) > 1 and not {"implausible", "doubtful"}.intersection(texts):
        return "ok"
    return _most(states, np.ones(len(states))) or "ok"


def _classes(
    sightings: Sightings, sign: IntArray, order: IntArray, edges: IntArray
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Class of each sign, its share of the belief, and which sightings [n] are from before its
    class became another one between drives."""
    m = len(edges) - 1
    code, share = np.zeros(m, np.int64), np.ones(m)
    before = np.zeros(len(sign), np.bool_)
    codes = sightings.code[order]
    weights = np.maximum(sightings.confidence[order], LEAST_CONFIDENCE)
    lowest = np.minimum.reduceat(codes, edges[:-1])
    plain = lowest == np.maximum.reduceat(codes, edges[:-1])
    code[plain] = lowest[plain]
    for k in np.flatnonzero(~plain).tolist():
        a, b = int(edges[k]), int(edges[k + 1])
        own, small = np.unique(codes[a:b], return_inverse=True)
        start = _change_point(small, len(own))
        before[order[a : a + start]] = True
        now, belief = codes[a + start : b], weights[a + start : b]
        total = np.bincount(now, belief)
        code[k] = int(np.argmax(total))
        share[k] = float(total[code[k]] / total.sum())
    return code, share, before


@kernel
def _change_point(codes: IntArray, n_classes: int) -> int:
    """Where in a sequence [n] of sightings, by time, the sign's class became another; 0 never.

    The likelihood of one class throughout against that of one before and another after,
    the change itself being rare. ``codes`` are below ``n_classes``.
    """
    right, wrong = np.log(CLASS_RIGHT), np.log(_FALSE_SHARE)
    n = len(codes)
    before = np.zeros(n_classes, np.int64)
    after = np.zeros(n_classes, np.int64)
    for code in codes:
        after[code] += 1
    hits = after.max()
    best, at = hits * right + (n - hits) * wrong, 0
    for k in range(1, n):
        before[codes[k - 1]] += 1
        after[codes[k - 1]] -= 1
        first, second = np.argmax(before), np.argmax(after)
        hits = before[first] + after[second]
        told = hits * right + (n - hits) * wrong + np.log(CHANGED)
        if told > best and first != second:
            best, at = told, k
    return at
