"""Simulated towns, their maps, and inventories made from the truth with known faults put in."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from merge_scene import CLASSES, Errors, Town, drive_through, street, to_geodetic

from automap.inventory.comparison import InventoryComparison
from automap.inventory.findings import Finding, Inventory
from automap.mapping.limits import LEAST_EXISTENCE
from automap.mapping.merge import merge_drives
from automap.mapping.sightings import DriveSigns
from automap.records import FloatArray, Sign

CLEAN = Errors(missed=0.02, clutter=0.0, wrong_class=0.0)
KINDS = ("matched", "new", "moved", "class", "missing")
TELLING = 2.5
"""How far the evidence of right and wrong things lies apart, in sigmas of it: what of 100 false
things is believed to 0.9, and more, is then some four."""


def calibrated(rng: np.random.Generator, right: np.ndarray, share: float) -> FloatArray:
    """Beliefs [n] in things that are ``right`` [n], a ``share`` of all: of those believed to p the
    part p is. Evidence is normal with means of half its variance to either side."""
    if share >= 1.0:
        return np.full(len(right), 0.999)
    sign = np.where(right, 0.5, -0.5)
    evidence = sign * TELLING**2 + TELLING * rng.standard_normal(len(right))
    return np.asarray(1.0 / (1.0 + (1.0 - share) / share * np.exp(-evidence)))


def beliefs(
    rng: np.random.Generator, drive: DriveSigns, truth: np.ndarray, town: Town, errors: Errors
) -> tuple[FloatArray, FloatArray]:
    """Existence [n] of a drive's signs, and confidence: that they exist and are of their class."""
    real = truth >= 0
    exists = calibrated(rng, real, 1.0 / (1.0 + errors.clutter))
    named = np.array([str(town.class_name[k]) if k >= 0 else "" for k in truth])
    right = named == drive.class_name.astype(str)
    of_class = calibrated(rng, right | ~real, 1.0 - errors.wrong_class)
    return exists, exists * of_class


def signs_of(drive: DriveSigns, exists: FloatArray, confidence: FloatArray) -> list[Sign]:
    """The drive's signs as a map has them."""
    return [
        Sign(
            drive.ids[k], str(drive.class_name[k]), drive.lat_rad[k], drive.lon_rad[k],
            drive.height_m[k], drive.cov_enu[k], float(confidence[k]), 9, 0, 0, 2.0,
            drive.facing_rad[k], 0.6, "", existence=float(exists[k]),
        )
        for k in range(len(drive))
    ]  # fmt: skip


LOOKED, SEEN = 20, 0.95
"""Frames that should show a sign, and the part that does: nothing stands before signs."""


@dataclass
class Faulty:
    """An inventory, the true sign of each row (-1: stands nowhere), and the faults put in."""

    inventory: Inventory
    origin: np.ndarray
    kind: np.ndarray
    deleted: set[int]


def faulty(
    rng: np.random.Generator, town: Town, sd: float = 0.3, shift: tuple[float, float] = (0.0, 0.0)
) -> Faulty:
    """5 % deleted, 5 % moved by 8 m, 3 % of another class, 4 % that stand no more."""
    n = len(town.position)
    order = rng.permutation(n)
    part = max(round(0.05 * n), 1), max(round(0.03 * n), 1)
    deleted, moved, other = np.split(order[: 2 * part[0] + part[1]], [part[0], 2 * part[0]])
    kept = np.setdiff1d(np.arange(n), deleted)
    position, names = town.position.copy(), town.class_name.copy()
    angle = rng.uniform(0.0, 2.0 * np.pi, len(moved))
    position[moved, :2] += 8.0 * np.column_stack([np.sin(angle), np.cos(angle)])
    for k in other:
        names[k] = rng.choice([c for c in CLASSES if c != names[k]])
    extra = rng.choice(n, max(round(0.04 * n), 1), replace=False)
    gone = town.position[extra] + np.array([0.0, 30.0, 0.0])
    kind = np.full(n, "matched", object)
    kind[moved], kind[other] = "moved", "class"
    at = np.vstack([position[kept], gone])
    at[:, :2] += sd * rng.standard_normal((len(at), 2)) + np.array(shift)
    lat, lon, _ = to_geodetic(at)
    inventory = Inventory(
        [f"K{k}" for k in range(len(at))],
        [str(c) for c in np.concatenate([names[kept], town.class_name[extra]])],
        lat, lon,
        np.concatenate([town.facing[kept], town.facing[extra]]),
        np.full(len(at), np.nan),
    )  # fmt: skip
    origin = np.concatenate([kept, np.full(len(extra), -1)])
    kinds = np.concatenate([kind[kept], np.full(len(extra), "missing", object)])
    return Faulty(inventory, origin, kinds, set(deleted.tolist()))


def due(result: InventoryComparison, case: Faulty, truth: np.ndarray, kind: str) -> int:
    """How many findings of a kind there ought to be, over the true signs that the map has."""
    seen = set(truth.tolist())
    if kind == "new":
        return len(case.deleted & seen)
    rows = np.flatnonzero(case.kind == kind).tolist()
    if kind == "missing":
        # those out of view are "not_seen"
        out = {f.listed for f in result.findings if f.kind == "not_seen"}
        return len([k for k in rows if k not in out])
    return sum(int(case.origin[k]) in seen for k in rows)


def correct(finding: Finding, case: Faulty, truth: np.ndarray) -> bool:
    """Whether a finding is one of the faults that were put in."""
    if finding.kind == "new":
        return int(truth[finding.sign]) in case.deleted
    if finding.kind == "missing":
        return bool(case.kind[finding.listed] == "missing")
    return bool(
        case.kind[finding.listed] == finding.kind
        and case.origin[finding.listed] == truth[finding.sign]
    )


def judged(
    result: InventoryComparison, case: Faulty, truth: np.ndarray, sure: bool = False
) -> dict[str, tuple[int, int, int]]:
    """Right, told and due findings of each kind; of the ``sure`` ones only, if wanted."""
    score = {}
    for kind in KINDS:
        told = [f for f in result.findings if f.kind == kind and (f.sure or not sure)]
        right = sum(correct(f, case, truth) for f in told)
        score[kind] = (right, len(told), due(result, case, truth, kind))
    return score


def there_and_back(length_m: float) -> np.ndarray:
    """Corners of a path up a street and down its other side."""
    low, high = -60.0, length_m + 60.0
    return np.array([[2.0, low], [2.0, high], [-2.0, high], [-2.0, low]])


def town_and_drive(
    seed: int, length_m: float = 6000.0, errors: Errors = CLEAN
) -> tuple[np.random.Generator, Town, list[DriveSigns], np.ndarray, list[Sign]]:
    """A street, one drive that passes each sign once, its true signs and its map."""
    rng = np.random.default_rng(seed)
    town = street(rng, length_m, 25.0)
    drive, truth = drive_through(rng, town, there_and_back(length_m), 12.0, "a", 1e9, errors)
    exists, confidence = beliefs(rng, drive, truth, town, errors)
    return rng, town, [drive], truth, signs_of(drive, exists, confidence)


def merged_town(
    seed: int, drives: int, length_m: float, errors: Errors
) -> tuple[np.random.Generator, Town, list[DriveSigns], np.ndarray, list[Sign]]:
    """The same after several drives, a day apart, that are merged."""
    rng = np.random.default_rng(seed)
    town = street(rng, length_m, 25.0)
    parts: list[DriveSigns] = []
    known: dict[str, np.ndarray] = {}
    for number in range(drives):
        name, start = f"pass-{number}", 1.4e9 + 86400.0 * number
        path = there_and_back(length_m)
        drive, truth = drive_through(rng, town, path, 12.0, name, start, errors)
        exists, confidence = beliefs(rng, drive, truth, town, errors)
        frames = np.full(len(exists), SEEN), np.full(len(exists), float(LOOKED))
        parts.append(replace(
            drive, confidence=confidence, existence=exists,
            seen_share=frames[0], n_looked=frames[1],
        ))  # fmt: skip
        known[name] = truth
    merged = merge_drives(parts)
    origin = [
        int(known[merged.drives[d].name][row])
        for d, row in zip(
            merged.sightings.drive.tolist(), merged.sightings.row.tolist(), strict=True
        )
    ]
    kept = np.flatnonzero(merged.existence >= LEAST_EXISTENCE).tolist()
    truth = np.full(len(kept), -1)
    for place, k in enumerate(kept):
        own = np.array(origin)[merged.sign == k]
        values, count = np.unique(own, return_counts=True)
        truth[place] = values[np.argmax(count)]
    return rng, town, merged.drives, truth, [merged.signs[k] for k in kept]
