"""When a video began, by the date and time in its file's name."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.evaluation import plausibility
from automap.io.video import read_header
from automap.records import FloatArray
from pipeline.init.draft import AS_UTC, Draft

DATED = re.compile(
    r"(?<!\d)(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)[-_. T]{0,3}"
    r"([0-2]\d)[-_.:h]?([0-5]\d)[-_.:m]?([0-5]\d)(?:\d{3})?(?!\d)"
)
"""Date and time of day as cameras write them into names, thousandths behind them or not."""
_HALF_SECOND = 0.5
"""Names tell whole seconds that have begun."""
_SIGMA_S = 1.0
"""A camera that hears GPS begins within a second or two of the one that its name tells. Bends and
signs then tell how far off it is; one that was set by hand is off by more, and a run says so."""
ZONES_H = np.arange(-12.0, 14.25, 0.25)
"""The zones of the world, h."""
_MOST = 0.5
"""A video of a drive shares half of itself with it, or holds half of it."""


def named_second(name: str) -> float | None:
    """The date and time in a name, as UNIX seconds if they were in UTC."""
    found = DATED.search(name)
    if found is None:
        return None
    try:
        year, month, day, hour, minute, second = map(int, found.groups())
        return datetime(year, month, day, hour, minute, second, tzinfo=UTC).timestamp()
    except ValueError:
        return None


def start_videos(draft: Draft, span: FloatArray) -> None:
    """Put the beginnings of videos without frame times in, by their names, where these and what was
    recorded between two times ``span`` [2] (s of UNIX) overlap."""
    for section in [each for each in draft.sections if each.startswith("video.")]:
        files: list[Path] = draft.get(section, "files") or []
        local_s = named_second(files[0].name) if files else None
        if local_s is None or draft.get(section, "frames") is not None:
            continue
        length_s = _length_s(files)
        both = {ahead: _shared(local_s - ahead, length_s, span) for ahead in _zones(draft)}
        enough = _MOST * min(length_s, float(np.ptp(span)))
        fitting = [ahead for ahead, shared in both.items() if shared >= enough]
        if not fitting:
            draft.doubt(
                section,
                f"the name of {files[0].name} tells a time at which nothing else was recorded: its "
                "signs cannot be placed before start_ns tells when it began",
            )
            continue
        # a zone that is told and UTC come before those that fit no better than they
        first = [ahead for ahead in (*_told_zones(draft), 0.0) if ahead in fitting]
        ahead_s = first[0] if first else max(fitting, key=lambda each: both[each])
        hours = sum(ahead % 3600.0 == 0.0 for ahead in fitting)
        if hours > 1 and ahead_s not in _told_zones(draft):
            draft.doubt(
                section,
                f"the time in the name of {files[0].name} lies in the drive in {hours} zones; "
                f"{_zone_name(ahead_s)} is taken: correct start_ns if its clock had another",
            )
        at = int((local_s - ahead_s + _HALF_SECOND) * 1e9)
        draft.set(section, "time", "unix_ns", "the clock of start_ns")
        draft.set(
            section,
            "start_ns",
            at,
            f"the second in the name of {files[0].name}, {_zone_name(ahead_s)}",
        )
        draft.set(
            section,
            "time_offset_sigma_s",
            _SIGMA_S,
            "no name tells better: bends and signs have to; frame times are better",
        )


def _told_zones(draft: Draft) -> list[float]:
    """How many s the tables' times are ahead of UTC, where something told."""
    return [
        3600.0 * draft.get(section, "utc_offset_h")
        for section in ("imu", "gnss", "odometer")
        if draft.get(section, "utc_offset_h") and draft.why(section, "utc_offset_h") != AS_UTC
    ]


def _zones(draft: Draft) -> list[float]:
    """How many s clocks may be ahead of UTC; the zone of the tables first, then UTC."""
    return list(dict.fromkeys([*_told_zones(draft), 0.0, *(3600.0 * ZONES_H).tolist()]))


def _zone_name(ahead_s: float) -> str:
    return f"{ahead_s / 3600.0:+g} h of UTC" if ahead_s else "UTC"


def _shared(start_s: float, length_s: float, span: FloatArray) -> float:
    return plausibility.overlap_s(np.array([start_s, start_s + length_s]), span)


def _length_s(files: list[Path]) -> float:
    """How long a video is, its chapters together; a second for one that does not say."""
    total = 0.0
    for path in files:
        try:
            total += read_header(path).duration_s
        except InputError:
            continue
    return total if np.isfinite(total) and total > 0.0 else 1.0
