"""What a person decided about signs, and the signs as they are after it.

A review is a list of actions that only grows. Each names the sign that it concerns and keeps
what the reviewer saw (class and position), so that it still finds its sign when a new run has
numbered the signs anew or moved them a little.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from automap.mapping import limits
from automap.records import FloatArray, ReviewAction, Sign

Status = Literal["", "accepted", "rejected", "corrected"]


@dataclass(frozen=True)
class Verdict:
    """What all actions on one sign come to; None leaves the value as it is."""

    sign: str
    status: Status
    seen_class: str
    seen_lon_deg: float
    seen_lat_deg: float
    class_name: str | None = None
    lon_deg: float | None = None
    lat_deg: float | None = None
    sd_m: float | None = None
    note: str = ""


@dataclass(frozen=True)
class Reviewed:
    """Signs after a review: those for the map, those rejected, and sentences about the rest."""

    signs: list[Sign]
    rejected: list[Sign]
    problems: list[str] = field(default_factory=list)


def verdicts(actions: Iterable[ReviewAction]) -> dict[str, Verdict]:
    """The state of every sign that was reviewed, by its id, in the order of first review."""
    by_sign: dict[str, list[ReviewAction]] = {}
    for action in standing(actions):
        kept = by_sign.setdefault(action.sign, [])
        if action.kind == "reset":
            kept.clear()
        else:
            kept.append(action)
    return {sign: _verdict(sign, kept) for sign, kept in by_sign.items() if kept}


def standing(actions: Iterable[ReviewAction]) -> list[ReviewAction]:
    """The actions that were not taken back, in their order, without the undoing ones."""
    listed = list(actions)
    undone: set[str] = set()
    # an undo may itself be undone, so the last word is heard first
    for action in reversed(listed):
        if action.kind == "undo" and action.undoes and action.id not in undone:
            undone.add(action.undoes)
    return [a for a in listed if a.kind != "undo" and a.id not in undone]


def _verdict(sign: str, actions: list[ReviewAction]) -> Verdict:
    seen = actions[0]
    verdict = Verdict(sign, "", seen.seen_class, seen.seen_lon_deg, seen.seen_lat_deg)
    corrected = False
    for action in actions:
        if action.class_name is not None:
            verdict = replace(verdict, class_name=action.class_name)
            corrected = True
        if action.lon_deg is not None and action.lat_deg is not None:
            verdict = replace(
                verdict, lon_deg=action.lon_deg, lat_deg=action.lat_deg, sd_m=action.sd_m
            )
            corrected = True
        if action.note is not None:
            verdict = replace(verdict, note=action.note)
        if action.kind == "reject":
            verdict = replace(verdict, status="rejected")
        elif action.kind in ("accept", "correct"):
            verdict = replace(verdict, status="corrected" if corrected else "accepted")
    return verdict


def apply_review(signs: Sequence[Sign], actions: Iterable[ReviewAction]) -> Reviewed:
    """Signs with the review applied, in their order.

    An accepted or corrected sign says so in ``status``; a rejected one is left out and listed
    apart; notes go with their signs. A position set by hand has the reviewer's uncertainty in
    place of the computed one. A verdict whose sign is not there any more becomes a sentence and
    changes nothing.
    """
    decided = list(verdicts(actions).values())
    rows = match(
        decided,
        [sign.id for sign in signs],
        [sign.class_name for sign in signs],
        np.degrees([sign.lon_rad for sign in signs]),
        np.degrees([sign.lat_rad for sign in signs]),
    )
    changed: dict[int, Sign] = {}
    lost = []
    for verdict, row in zip(decided, rows, strict=True):
        if row is not None:
            changed[row] = _changed(signs[row], verdict)
        elif verdict.status:
            lost.append(verdict.sign)
    after = [changed.get(row, sign) for row, sign in enumerate(signs)]
    problems = []
    if lost:
        named = ", ".join(lost[:5]) + (" and more" if len(lost) > 5 else "")
        problems.append(
            f"The review decided about {len(lost)} sign{'s' if len(lost) > 1 else ''} that the "
            f"map no longer has ({named}); the decisions stay in the review and change nothing."
        )
    return Reviewed(
        signs=[sign for sign in after if sign.status != "rejected"],
        rejected=[sign for sign in after if sign.status == "rejected"],
        problems=problems,
    )


def _changed(sign: Sign, verdict: Verdict) -> Sign:
    changes: dict[str, object] = {}
    if verdict.status:
        changes["status"] = verdict.status
    if verdict.note:
        changes["note"] = verdict.note
    if verdict.class_name is not None:
        changes["class_name"] = verdict.class_name
    if verdict.lon_deg is not None and verdict.lat_deg is not None:
        variance = (limits.HAND_SD_M if verdict.sd_m is None else verdict.sd_m) ** 2
        covariance = np.zeros((3, 3))
        covariance[0, 0] = covariance[1, 1] = variance
        covariance[2, 2] = sign.cov_enu[2, 2]
        changes |= {
            "lon_rad": float(np.radians(verdict.lon_deg)),
            "lat_rad": float(np.radians(verdict.lat_deg)),
            "cov_enu": covariance,
        }
    return replace(sign, **changes) if changes else sign  # type: ignore[arg-type]


def match(
    decided: Sequence[Verdict],
    ids: Sequence[str],
    classes: Sequence[str],
    lon_deg: FloatArray,
    lat_deg: FloatArray,
) -> list[int | None]:
    """For every verdict the row of its sign among signs [n], None where it is gone; no row twice.

    First by the same id near the same place, then by the same class near the same place, the
    nearest pair first. Signs or verdicts without a position are known by id and class.
    """
    row_of = {name: row for row, name in enumerate(ids)} if decided else {}
    rows: list[int | None] = [None] * len(decided)
    taken: set[int] = set()
    for number, verdict in enumerate(decided):
        row = row_of.get(verdict.sign)
        if row is None or row in taken:
            continue
        distance = float(_distance_m(verdict, lon_deg[row : row + 1], lat_deg[row : row + 1])[0])
        same_class = classes[row] == verdict.seen_class
        if distance <= limits.MATCH_M or (np.isnan(distance) and same_class):
            rows[number] = row
            taken.add(row)
    pairs = []
    for number, verdict in enumerate(decided):
        if rows[number] is None and len(ids):
            far = _distance_m(verdict, lon_deg, lat_deg)
            near = np.flatnonzero(far <= limits.MATCH_M).tolist()
            pairs += [
                (float(far[row]), number, row) for row in near if classes[row] == verdict.seen_class
            ]
    for _, number, row in sorted(pairs):
        if rows[number] is None and row not in taken:
            rows[number] = row
            taken.add(row)
    return rows


def _distance_m(verdict: Verdict, lon_deg: FloatArray, lat_deg: FloatArray) -> FloatArray:
    """Metres [n] to where the verdict's sign was seen; good near by, which is all it is for."""
    east = np.mod(lon_deg - verdict.seen_lon_deg + 180.0, 360.0) - 180.0
    east = east * np.cos(np.radians(verdict.seen_lat_deg))
    return np.asarray(111_195.0 * np.hypot(east, lat_deg - verdict.seen_lat_deg), np.float64)
