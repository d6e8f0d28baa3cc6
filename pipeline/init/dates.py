"""Dates of which day and month may be either: read so that readings and fixes are of one time."""

from __future__ import annotations

from collections.abc import Callable

from automap.io.calendar_text import other_reading
from automap.io.table_guess import DATES_DOUBT
from automap.timebase import MOST_ZONE_H
from pipeline.init.draft import Draft

_APART_S = 3600.0 * MOST_ZONE_H
"""Further than zones are from UTC two recordings of one drive are not; days and months that are
exchanged are, by four weeks and more."""


def settle_dates(draft: Draft, apart_s: Callable[[Draft], float | None]) -> None:
    """Exchange day and month in the dates of the readings or of the fixes, where by their numbers
    both may be and the two are then of one day.

    ``apart_s`` tells by how many s readings and fixes miss one another as a draft reads them, None
    where that is not known. Where both may be exchanged and agree as they are, they stay, and the
    doubt with them.
    """
    others = {section: _other(draft, section) for section in ("imu", "gnss")}
    if not any(others.values()):
        return
    apart = apart_s(draft)
    if apart is None or apart <= _APART_S:
        return
    for section, other in others.items():
        if other is None:
            continue
        before, why = draft.get(section, "time_format"), draft.why(section, "time_format")
        what = "the fixes" if section == "imu" else "the readings"
        draft.set(section, "time_format", other, f"so its dates are those of {what}")
        apart = apart_s(draft)
        if apart is not None and apart <= _APART_S:
            draft.withdraw(section, DATES_DOUBT.format(other))
            if all(others.values()):
                # they meet on the other day as well, with both exchanged
                draft.doubt(section, DATES_DOUBT.format(before))
            return
        draft.set(section, "time_format", before, why)


def _other(draft: Draft, section: str) -> str | None:
    """The other ``time_format`` that the dates of a section may have as well."""
    pattern = draft.get(section, "time_format")
    other = None if pattern is None else other_reading(pattern)
    doubted = other is not None and DATES_DOUBT.format(other) in draft.notes.get(section, ())
    return other if doubted else None
