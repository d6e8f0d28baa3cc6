"""What the actions of a review come to: the state of every sign that one of them concerns.

A review is a list of actions that only grows. Each names the sign that it concerns and keeps
what the reviewer saw (class and position), so that it still finds its sign when a new run has
numbered the signs anew or moved them a little.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Literal

from automap.records import PlacedSign, ReviewAction, SeenIn

Status = Literal["", "accepted", "rejected", "corrected", "added", "merged"]
_MAKING = ("add", "split", "merge")
"""Kinds that make signs or take them away: a reset of decisions leaves them."""
_DECIDING = ("accept", "reject", "correct", "add", "split", "merge")


@dataclass(frozen=True)
class Verdict:
    """What all actions on one sign come to; None leaves the value as it is.

    ``place`` is what was computed of a sign that was added, split or merged, if nobody moved it
    since. ``created`` says that the review itself made the sign (out of ``origin``, where that was
    a split), ``views`` of which views; ``into`` is the sign that it was merged into. ``reviewer``
    and ``time`` are those of the last decision, ``disputed`` who decided otherwise; ``note_by`` who
    wrote the note and on which day.
    """

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
    note_by: str = ""
    facing_deg: float | None = None
    height_above_road_m: float | None = None
    place: PlacedSign | None = None
    created: bool = False
    origin: str = ""
    views: tuple[SeenIn, ...] = ()
    into: str = ""
    reviewer: str = ""
    time: str = ""
    disputed: tuple[str, ...] = ()


@dataclass
class _Fold:
    """A verdict in the making; ``said`` what each reviewer last held of the sign."""

    verdict: Verdict
    changed: bool = False
    said: dict[str, tuple[bool, str]] = field(default_factory=dict)


def verdicts(actions: Iterable[ReviewAction]) -> dict[str, Verdict]:
    """The state of every sign that was reviewed, by its id, in the order of first review.

    Signs that the review made and unmade again are not among them.
    """
    listed = list(actions)
    by_sign: dict[str, list[ReviewAction]] = {}
    for action in standing(listed):
        for sign in (action.sign, *([action.other] if action.other else [])):
            kept = by_sign.setdefault(sign, [])
            if action.kind == "reset":
                kept[:] = [a for a in kept if a.kind in _MAKING]
            else:
                kept.append(action)
    born = {name for action in listed for name in makes(action)}
    found = {sign: _verdict(sign, kept) for sign, kept in by_sign.items() if kept}
    return {sign: v for sign, v in found.items() if v.created or sign not in born}


def makes(action: ReviewAction) -> tuple[str, ...]:
    """Signs that an action makes."""
    if action.kind == "add":
        return (action.sign,)
    return (action.other,) if action.kind == "split" and action.other else ()


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
    fold = _Fold(_seen(sign, actions[0]))
    for action in actions:
        if action.settles:
            fold.said.clear()
        _make(fold, sign, action)
        if sign == action.sign:
            _correct(fold, action)
        if action.kind in _DECIDING and sign == action.sign:
            verdict = fold.verdict
            fold.verdict = replace(verdict, reviewer=action.reviewer, time=action.time)
            if action.reviewer:
                fold.said[action.reviewer] = _held(fold.verdict)
    now = _held(fold.verdict)
    others = sorted(who for who, held in fold.said.items() if held != now)
    merged = fold.verdict.status == "merged"
    return replace(fold.verdict, disputed=() if merged else tuple(others))


def _held(verdict: Verdict) -> tuple[bool, str]:
    """What reviewers may disagree about: whether there is a sign, and of which class."""
    rejected = verdict.status == "rejected"
    return rejected, "" if rejected else verdict.class_name or verdict.seen_class


def _seen(sign: str, first: ReviewAction) -> Verdict:
    """A verdict that says nothing, of the sign as the reviewer saw it."""
    if sign == first.sign:
        return Verdict(sign, "", first.seen_class, first.seen_lon_deg, first.seen_lat_deg)
    return Verdict(
        *(sign, "", first.other_seen_class),
        *(first.other_seen_lon_deg, first.other_seen_lat_deg),
    )


def _make(fold: _Fold, sign: str, action: ReviewAction) -> None:
    """What an action that makes signs, or takes one away, does to this one."""
    own = sign == action.sign
    place = action.place if own else action.other_place
    if action.kind == "merge" and not own:
        fold.verdict = replace(
            *(fold.verdict,), status="merged", into=action.sign,
            reviewer=action.reviewer, time=action.time,
        )  # fmt: skip
        return
    if action.kind not in _MAKING:
        return
    # a place that is computed anew stands in that of a hand before it
    verdict = replace(fold.verdict, place=place, lon_deg=None, lat_deg=None, sd_m=None)
    fold.changed = True
    if action.kind == "add":
        verdict = replace(verdict, created=True, views=action.views, status="added")
    elif action.kind == "split" and not own:
        verdict = replace(
            *(verdict,), created=True, origin=action.sign, views=action.views,
            status="corrected", reviewer=action.reviewer, time=action.time,
        )  # fmt: skip
    else:
        verdict = replace(verdict, status="corrected")
    fold.verdict = verdict


def _correct(fold: _Fold, action: ReviewAction) -> None:
    """What an action decides about the sign that it names."""
    verdict = fold.verdict
    if action.lon_deg is not None and action.lat_deg is not None:
        verdict = replace(verdict, lon_deg=action.lon_deg, lat_deg=action.lat_deg, sd_m=action.sd_m)
        fold.changed = True
    for name in ("class_name", "facing_deg", "height_above_road_m"):
        if (value := getattr(action, name)) is not None:
            verdict = replace(verdict, **{name: value})
            fold.changed = True
    if action.note is not None:
        by = ", ".join(filter(None, (action.reviewer, action.time[:10])))
        verdict = replace(verdict, note=action.note, note_by=by)
    if action.kind == "reject":
        verdict = replace(verdict, status="rejected")
    elif action.kind in ("accept", "correct"):
        added = verdict.created and not verdict.origin
        kept: Status = "added" if added else "corrected" if fold.changed else "accepted"
        verdict = replace(verdict, status=kept)
    fold.verdict = verdict
