"""Signs that a reviewer rejected and that drives saw since: mostly the same mistake once more, but
perhaps one that was put up. The decision stands until somebody accepts one, so it is told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from automap.mapping.attributes import REJECTED
from automap.records import NO_TIME, Sign

if TYPE_CHECKING:
    from automap.mapping.merge import Merged


def by_later_drives(merged: Merged) -> list[str]:
    """A sentence about signs that the review of one drive keeps off the map, and later ones saw."""
    s, sign = merged.sightings, merged.sign
    off = np.asarray(s.status == REJECTED, np.bool_)
    # drives are in the order of their times
    first = np.full(len(merged.signs), s.n_drives)
    np.minimum.at(first, sign[off], s.drive[off])
    held = np.array([one.status == REJECTED for one in merged.signs], np.bool_)
    again = np.flatnonzero(~off & held[sign] & (s.drive > first[sign]))
    if not len(again):
        return []
    count, row = len(np.unique(sign[again])), int(again[0])
    return [
        f"{_signs(count)} that the review of a drive rejected {_was(count)} seen by later drives "
        f"(as {s.id[row]} of {merged.drives[int(s.drive[row])].name}); what was put up since is "
        "accepted in the review of such a drive."
    ]


def since_reviewed(rejected: Sequence[Sign]) -> list[str]:
    """A sentence about signs that the review of the map ``rejected``, and drives saw after it."""
    from automap.export.clock import iso_texts, utc_of_gps

    stamps = np.array([sign.last_seen_ns for sign in rejected], np.int64)
    seen = iso_texts(utc_of_gps(np.where(stamps == NO_TIME, np.nan, stamps * 1e-9)))
    again = [
        sign.id
        for sign, when in zip(rejected, seen, strict=True)
        if sign.reviewed and when is not None and when > sign.reviewed
    ]
    if not again:
        return []
    return [
        f"{_signs(len(again))} that the review of this map rejected {_was(len(again))} seen since "
        f"(as {again[0]}); automap view shows what is rejected, where what was put up is accepted."
    ]


def _signs(count: int) -> str:
    return f"{count} sign{'s' if count > 1 else ''}"


def _was(count: int) -> str:
    return "were" if count > 1 else "was"
