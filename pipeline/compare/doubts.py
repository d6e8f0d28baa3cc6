"""What of a list's own statements its signs contradict, and what is therefore not for work.

A list that is read wrong (another coordinate system, another catalogue, another town) differs from
the map in most of its entries, a list that is looked after in few of them. Where more of it
contradicts the map than agrees with it, it is likelier read wrong than wrong.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from automap.earth import metres_per_radian
from automap.export.inventory import WORK
from automap.inventory.classes import same_face
from automap.inventory.comparison import InventoryComparison, compare_inventory
from automap.inventory.findings import Finding, Inventory, seldom_found
from automap.inventory.limits import (
    LARGEST_SD_M,
    LEAST_TURNS,
    LIKELIER_THAN_NOT,
    TOLD_BY_CHANCE,
)
from automap.mapping.limits import MOVED_M
from automap.records import FloatArray, Sign
from automap.signs.codes import face_of
from pipeline.compare.alike import alike
from pipeline.compare.parts import displaced

_ELSEWHERE_M = 3.0 * MOVED_M
"""Further than two signs can be off from one another that are each taken for the same third one."""
PAIRED = ("matched", "moved", "class")


def doubts(
    result: InventoryComparison,
    signs: Sequence[Sign],
    listed: Inventory,
    path: Path,
    elsewhere: Collection[str] = (),
) -> tuple[list[str], list[Finding]]:
    """Sentences, and the findings with those that rest on what is doubtful as unsure, and no
    likelier than not; ``elsewhere`` are the classes of entries without a position."""
    told: list[str] = []
    withheld: set[int] = set()
    for sentence, rows in (
        *_places(result, signs, listed),
        *displaced(result, signs, listed),
        *alike(result.findings, listed),
        *_accuracy(result, listed),
        *_directions(result),
        *_classes(result, signs, listed),
        *_posts(result, signs),
        *_without_place(result, signs, elsewhere),
        *_kinds(result, signs, listed),
    ):
        told.append(f"{path}: {sentence}")
        withheld |= set(rows)
    findings = [
        replace(f, sure=False, probability=min(f.probability, LIKELIER_THAN_NOT))
        if k in withheld and f.kind in WORK
        else f
        for k, f in enumerate(result.findings)
    ]
    return told, findings


_Doubts = list[tuple[str, Sequence[int]]]


def _rows(result: InventoryComparison, *kinds: str) -> list[int]:
    return [k for k, f in enumerate(result.findings) if f.kind in kinds]


def _places(result: InventoryComparison, signs: Sequence[Sign], listed: Inventory) -> _Doubts:
    """Whether its entries stand where the map's signs do."""
    from scipy.stats import poisson

    everything = range(len(result.findings))
    paired = _rows(result, *PAIRED)
    if not paired and signs:
        return [(
            "none of its entries was found on the map, so whether it is of this place, and in "
            "which coordinate system, is not known: nothing is for work. Check its columns and "
            "--crs.",
            everything,
        )]  # fmt: skip
    if _few(len(paired), signs, listed):
        by_chance = _pairs_elsewhere(signs, listed)
        if poisson.sf(len(paired) - 1, by_chance) > TOLD_BY_CHANCE:
            return [(
                f"of {_entries(len(listed))} {len(paired)} were found, and {by_chance:.1f} would "
                "be if all were moved elsewhere: its positions may be in another coordinate "
                "system. Nothing is for work; check its columns and --crs.",
                everything,
            )]  # fmt: skip
    # of kinds of signs that no detector knows nothing is found
    in_view = [
        result.findings[k]
        for k in [*paired, *_rows(result, "missing", "unconfirmed")]
        if listed.class_name[result.findings[k].listed] or not any(listed.class_name)
    ]
    found = sum(f.kind in PAIRED for f in in_view)
    if found < LIKELIER_THAN_NOT * len(in_view):
        return [(
            f"of {len(in_view)} entries that the drives had in view {found} were found: its "
            "positions may be coarse or in another coordinate system. Nothing is for work; check "
            "--crs.",
            everything,
        )]  # fmt: skip
    if not signs:
        return []
    shift = float(np.hypot(*result.shift_m))
    # what the map may be off altogether is not the list's; 99 % of normal errors in a plane
    own = float(np.median([0.5 * np.trace(s.cov_enu[:2, :2]) for s in signs]))
    if shift > max(2.0 * result.sd_m, 3.03 * math.sqrt(own)):
        return [(
            f"all of it lies {shift:.1f} m off the map ({result.shift_m[0]:+.1f} m east, "
            f"{result.shift_m[1]:+.1f} m north), which is taken off; its datum may be another.",
            (),
        )]  # fmt: skip
    return []


def _few(paired: int, signs: Sequence[Sign], listed: Inventory) -> bool:
    """Whether less than half of the map, and of the list, have another."""
    return paired < LIKELIER_THAN_NOT * min(len(listed), len(signs))


def _pairs_elsewhere(signs: Sequence[Sign], listed: Inventory) -> float:
    """How many entries are paired on average where all of them are moved so far north, south, east
    or west that no sign is near its own."""
    north, east = (float(v) for v in metres_per_radian(float(np.mean(listed.lat_rad)), 0.0))
    counts = []
    for to_north, to_east in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        moved = replace(
            listed,
            lat_rad=listed.lat_rad + to_north * _ELSEWHERE_M / north,
            lon_rad=listed.lon_rad + to_east * _ELSEWHERE_M / east,
        )
        result = compare_inventory(signs, moved, [])
        counts.append(len(_rows(result, *PAIRED)))
    return float(np.mean(counts))


def _accuracy(result: InventoryComparison, listed: Inventory) -> _Doubts:
    """Whether its positions are as good as it states, and good enough to tell signs apart."""
    told: _Doubts = []
    stated = np.asarray(listed.sd_m, np.float64)
    coarse = int((stated > LARGEST_SD_M).sum())
    if coarse:
        told.append((
            f"the accuracy of {_entries(coarse)} is stated as worse than {LARGEST_SD_M:.0f} m, as "
            f"{np.nanmax(stated):.4g} m: is it in metres? {LARGEST_SD_M:.0f} m are taken.",
            (),
        ))  # fmt: skip
    if np.isnan(stated).any() and result.sd_m >= LARGEST_SD_M:
        told.append((
            f"its positions err by {LARGEST_SD_M:.0f} m and more, so that it cannot be told which "
            "sign is which: what is new, moved or missing is not for work.",
            _rows(result, "new", "moved", "missing"),
        ))  # fmt: skip
    # twice the stated error is more than rounding
    if result.normalised_square > 4.0:
        told.append((
            "its stated accuracy is too good: signs in place are "
            f"{math.sqrt(result.normalised_square):.1f} times as far off, so many are called "
            "moved.",
            (),
        ))  # fmt: skip
    poor = _times_nearer(result, np.minimum(stated, LARGEST_SD_M))
    if poor > 2.0:
        told.append((
            f"its stated accuracy is too poor: signs in place are {poor:.1f} times nearer than it "
            "says, so few can be called moved.",
            (),
        ))  # fmt: skip
    return told


def _times_nearer(result: InventoryComparison, stated: FloatArray) -> float:
    """How many times nearer to where they are listed matched signs were found than the list's error
    alone should have brought them; 1 where that may be chance."""
    from scipy.stats import chi2

    squares = [
        result.findings[k].distance_m ** 2 / stated[result.findings[k].listed] ** 2
        for k in _rows(result, "matched")
        if np.isfinite(stated[result.findings[k].listed])
    ]
    freedom = 2.0 * len(squares)
    if not squares or chi2.cdf(sum(squares), freedom) > TOLD_BY_CHANCE:
        return 1.0
    return math.sqrt(freedom / max(sum(squares), 1e-6))


def _directions(result: InventoryComparison) -> _Doubts:
    """Whether its directions are those of faces."""
    found = result.directions
    told: _Doubts = []
    if found.gon:
        told.append(("its directions are in gon, of which 400 are a turn; so they are taken.", ()))
    if found.turned:
        told.append(
            ("its directions are those of traffic; faces are taken to look the other way.", ())
        )
    if found.doubtful or not found.used:
        told.append((
            f"the directions of {found.against} of {found.told} entries contradict the map's; "
            + ("check that they are degrees clockwise from north." if found.used
               else "they are not used. They should be degrees clockwise from north."),
            (),
        ))  # fmt: skip
    return told


def _classes(result: InventoryComparison, signs: Sequence[Sign], listed: Inventory) -> _Doubts:
    """Whether its codes are read as what they mean."""
    other = [
        k for k in _rows(result, "class") if result.findings[k].probability > LIKELIER_THAN_NOT
    ]
    same = sum(
        bool(same_face(signs[f.sign].class_name, listed.class_name[f.listed]))
        for f in (result.findings[k] for k in _rows(result, "matched", "moved"))
    )
    if len(other) < LEAST_TURNS or len(other) <= same:
        return []
    return [(
        f"of {len(other) + same} entries that were found and can be compared {len(other)} have "
        "another class than the map: its codes may be of another catalogue (--country) or its "
        "classes in another column (--columns class=NAME). Other classes are not for work.",
        # where few are paired they may be pairs by chance
        range(len(result.findings)) if _few(len(other) + same, signs, listed) else
        _rows(result, "class"),
    )]  # fmt: skip


def _posts(result: InventoryComparison, signs: Sequence[Sign]) -> _Doubts:
    """Whether it has a row for each post where the map has one for each face."""
    listed = Counter(
        signs[result.findings[k].sign].support for k in _rows(result, *PAIRED)
    )  # fmt: skip
    several = Counter(s.support for s in signs if s.support)
    posts = {p: listed[p] for p, n in several.items() if n > 1 and listed[p]}
    single = {post for post, n in posts.items() if n == 1}
    if len(single) < LEAST_TURNS or len(single) <= LIKELIER_THAN_NOT * len(posts):
        return []
    return [(
        f"on {len(single)} of {len(posts)} posts with several faces it has one entry: it may have "
        "a row for each post and not for each face. What is new on these is not for work.",
        [k for k in _rows(result, "new") if signs[result.findings[k].sign].support in single],
    )]  # fmt: skip


def _without_place(
    result: InventoryComparison, signs: Sequence[Sign], classes: Collection[str]
) -> _Doubts:
    """Whether what is new may be one of the entries of which nobody knows where they are."""
    faces = {face_of(name) for name in classes if name}
    rows = [
        k
        for k in _rows(result, "new")
        if face_of(signs[result.findings[k].sign].class_name) in faces
    ]
    if not rows:
        return []
    return [(
        f"{len(rows)} new signs are of a class that entries without a position have; they may be "
        "these, and are not for work.",
        rows,
    )]  # fmt: skip


def _kinds(result: InventoryComparison, signs: Sequence[Sign], listed: Inventory) -> _Doubts:
    """Which kinds of signs were seldom found."""
    found, in_view = np.zeros((2, len(listed)), np.bool_)
    found[[result.findings[k].listed for k in _rows(result, *PAIRED)]] = True
    in_view[[result.findings[k].listed for k in _rows(result, "missing", "unconfirmed")]] = True
    new = [signs[result.findings[k].sign].class_name for k in _rows(result, "new")]
    seldom = np.flatnonzero(seldom_found(listed, found, in_view | found, new) & ~found).tolist()
    if len(seldom) < LEAST_TURNS:
        return []
    most = Counter(listed.class_name[k] or "no known class" for k in seldom).most_common(3)
    return [(
        f"{len(seldom)} entries are of kinds of which the drives found less than half of those in "
        f"view, such as {', '.join(f'{name} ({n})' for name, n in most)}: the detector may not "
        "know them, so they are not called missing.",
        (),
    )]  # fmt: skip


def _entries(n: int) -> str:
    return "one entry" if n == 1 else f"{n} entries"
