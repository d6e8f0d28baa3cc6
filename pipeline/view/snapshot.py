"""A map's signs with a review at one moment: which row has which verdict, and what it made."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.records import ReviewAction, Sign
from automap.review.reviewed import Renamed, created_sign, match, renamed_views
from automap.review.verdicts import Verdict, makes, verdicts
from pipeline.view.signs import SignTable, table_of


@dataclass(frozen=True)
class Snapshot:
    """The review after some actions. ``rows`` are those of the page by the names that the review
    has for signs; the signs of ``made``, undone ones too, stand behind the map's own, in ``table``.
    ``renamed`` is by the page's names."""

    actions: list[ReviewAction]
    state: dict[str, Verdict]
    rows: dict[str, int]
    made: list[str]
    table: SignTable | None
    renamed: Renamed


def snapshot(signs: SignTable, actions: list[ReviewAction]) -> Snapshot:
    """What some actions come to for the signs of a map."""
    state = verdicts(actions)
    decided = [v for v in state.values() if not v.created]
    classes = np.array(signs.classes, object)[signs.class_index].tolist() if decided else []
    found = match(decided, signs.ids, classes, signs.lon_deg, signs.lat_deg)
    rows = {v.sign: row for v, row in zip(decided, found, strict=True) if row is not None}
    made = list(dict.fromkeys(name for action in actions for name in makes(action)))
    rows |= {name: len(signs) + k for k, name in enumerate(made) if name in state}
    called = {name: signs.ids[row] if row < len(signs) else name for name, row in rows.items()}
    built = []
    for name in made:
        verdict = state.get(name)
        sign = created_sign(verdict) if verdict is not None else None
        if sign is None:
            sign = _nothing(name)
        elif verdict is not None and rows.get(verdict.origin, len(signs)) < len(signs):
            origin = rows[verdict.origin]
            worth = float(signs.confidence[origin]), float(signs.existence[origin])
            sign = replace(sign, confidence=worth[0], existence=worth[1])
        built.append(sign)
    table = table_of(built) if built else None
    return Snapshot(actions, state, rows, made, table, renamed_views(state, called))


def _nothing(name: str) -> Sign:
    """What stands for a sign that was made and unmade again."""
    nan = float("nan")
    unknown = np.full((3, 3), nan)
    return Sign(name, "", nan, nan, nan, unknown, nan, 0, 0, 0, nan, nan, nan, "")
