"""Runs that are no passes of their own: parts of one recording, one receiver's fixes in two drives,
two recorders in one vehicle.

A merge takes drives to err independently. What two of them have from one receiver counts twice, and
the map's sigmas come out too small.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from automap.earth import MEAN_RADIUS
from automap.io import names
from automap.records import ClockModel, FloatArray, IntArray
from pipeline.shared.values import number

EVERY_S = 30.0
"""A mark every so many seconds of GPS time: three and more in a drive that is worth a merge, four
kilobytes an hour."""
_BESIDE_S = 10.0
"""Fixes that are further apart tell nothing of a mark between them; slow loggers have that."""
_SAME_RAD = 1e-9
"""6 mm: half of the last digit of a u-blox (1e-7 deg), so positions that agree at all marks are the
same numbers; those of two receivers differ by decimetres and more."""
_CELL_M = 100.0
_TOGETHER_M = 10.0
"""A vehicle's length and what two phones err by. One that follows is further off: a second of way
and its own length, 15 m in a town."""
_LEAST_MARKS = 3
_WAY_M = 100.0
"""Cars that are parked side by side do not go together."""
_SAME_FRAMES = 0.2
"""Of a video some frames are searched, in towns every sixth, along two paths of one drive mostly
the same. Stamps of two cameras that are rounded to ms agree once in 33."""


@dataclass(frozen=True)
class Marks:
    """Where a receiver was at whole multiples of ``EVERY_S``: their ``count`` [n], ``lat_rad`` and
    ``lon_rad`` [n] between its fixes, and ``frame_ns`` [n] the stamp of the first boxes after each,
    up to the next (0 none)."""

    count: IntArray
    lat_rad: FloatArray
    lon_rad: FloatArray
    frame_ns: IntArray

    def told(self) -> list[list[float]]:
        """As JSON has them."""
        return [
            [int(count), round(float(lat), 10), round(float(lon), 10), int(frame)]
            for count, lat, lon, frame in zip(
                self.count, self.lat_rad, self.lon_rad, self.frame_ns, strict=True
            )
        ]


@dataclass(frozen=True)
class Double:
    """Two runs, by their places: ``part`` is left out, as the recording of ``whole`` has it all
    (``alike``: and the other way round); without one ``same`` says whether they have the same
    fixes, ``apart_m`` how far apart they are in the median, ``from_s`` to ``to_s`` (GPS) when."""

    part: int
    whole: int
    left_out: bool
    same: bool
    apart_m: float
    from_s: float
    to_s: float
    alike: bool = False


def marks_of(folder: Path, clock: ClockModel | None, stamps: IntArray | None) -> Marks | None:
    """The marks of a run by its fixes and the stamps of its boxes; None without fixes."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(folder / names.FIXES) as file:
            table = file.read(["gps_s", "lat_rad", "lon_rad", "fix_type"], use_threads=False)
        gps_s, lat, lon, kind = (
            np.asarray(column.cast(pa.float64()).to_numpy(), np.float64) for column in table.columns
        )
    except (pa.ArrowException, OSError, KeyError, ValueError):
        return None
    good = np.isfinite(gps_s) & np.isfinite(lat) & np.isfinite(lon) & (kind > 0)
    order = np.flatnonzero(good)[np.argsort(gps_s[good], kind="stable")]
    if len(order) < 2:
        return None
    return _marks(gps_s[order], lat[order], lon[order], clock, stamps)


def _marks(
    gps_s: FloatArray,
    lat: FloatArray,
    lon: FloatArray,
    clock: ClockModel | None,
    stamps: IntArray | None,
) -> Marks:
    # the multiples that lie between fixes: a log with a jump of weeks has few
    count = np.unique(np.concatenate([np.ceil(gps_s / EVERY_S), np.floor(gps_s / EVERY_S)]))
    at = count * EVERY_S
    after = np.searchsorted(gps_s, at)
    inside = (after > 0) & (after < len(gps_s))
    count, at, after = count[inside], at[inside], after[inside]
    near = gps_s[after] - gps_s[after - 1] <= _BESIDE_S
    count, at = count[near].astype(np.int64), at[near]
    frame = np.zeros(len(count), np.int64)
    if clock is not None and stamps is not None and len(stamps):
        seen = np.unique(stamps)
        seen_s = clock.gps_s(seen)
        first = np.minimum(np.searchsorted(seen_s, at), len(seen) - 1)
        within = (seen_s[first] >= at) & (seen_s[first] < at + EVERY_S)
        frame[within] = seen[first[within]]
    return Marks(count, np.interp(at, gps_s, lat), np.interp(at, gps_s, lon), frame)


def marks_told(value: Any) -> Marks | None:
    """Marks as JSON has them; None where there are none or they are damaged."""
    rows = value if isinstance(value, list) else []
    good = [r for r in rows if isinstance(r, list) and len(r) == 4]
    if not good or any(number(cell) is None for row in good for cell in row):
        return None
    count, lat, lon, frame = zip(*good, strict=True)
    return Marks(np.array(count, np.int64), np.array(lat), np.array(lon), np.array(frame, np.int64))


def doubles(marks: Sequence[Marks | None]) -> list[Double]:
    """Pairs of runs that are no two passes, in the order of the runs, those that are preferred
    first; of runs of one recording a part is left out, of two that have it all the later."""
    out: set[int] = set()
    found = []
    for a, b in sorted(_candidates(marks)):
        first, second = marks[a], marks[b]
        if first is None or second is None or a in out or b in out:
            continue
        _, at, there = np.intersect1d(first.count, second.count, return_indices=True)
        apart = _apart_m(first, at, second, there)
        same = bool(np.all(apart <= _SAME_RAD * MEAN_RADIUS))
        if not (same or _together(first, at, apart)):
            continue
        alike = same and _alike(first, second, len(at))
        part, whole = (a, b) if len(first.count) < len(second.count) and not alike else (b, a)
        if _sees(marks[part]) and not _sees(marks[whole]):
            # what has no boxes counts nothing twice, and does not hold those of another
            continue
        left_out = same and _holds(marks[part], len(at)) and _same_frames(first, at, second, there)
        if left_out:
            out.add(part)
        start, end = (first.count[at[[0, -1]]] * EVERY_S).tolist()
        found.append(
            Double(part, whole, left_out, same, float(np.median(apart)), start, end, alike)
        )
    # what a part has in common with others its whole has as well
    return [d for d in found if d.left_out or not {d.part, d.whole} & out]


def _candidates(marks: Sequence[Marks | None]) -> set[tuple[int, int]]:
    """Runs that were in one cell at one time."""
    there: Mapping[tuple[int, int, int], list[int]] = defaultdict(list)
    for k, mark in enumerate(marks):
        for key in _cells(mark):
            there[key].append(k)
    return {pair for runs in there.values() for pair in combinations(runs, 2)}


def _cells(mark: Marks | None) -> Iterator[tuple[int, int, int]]:
    if mark is None:
        return
    row = np.floor(mark.lat_rad * MEAN_RADIUS / _CELL_M).astype(np.int64)
    along = np.cos(row * _CELL_M / MEAN_RADIUS)
    column = np.floor(mark.lon_rad * along * MEAN_RADIUS / _CELL_M).astype(np.int64)
    yield from zip(mark.count.tolist(), row.tolist(), column.tolist(), strict=True)


def _apart_m(first: Marks, at: IntArray, second: Marks, there: IntArray) -> FloatArray:
    north = second.lat_rad[there] - first.lat_rad[at]
    east = (second.lon_rad[there] - first.lon_rad[at]) * np.cos(first.lat_rad[at])
    return np.asarray(np.hypot(north, east) * MEAN_RADIUS, np.float64)


def _together(first: Marks, at: IntArray, apart: FloatArray) -> bool:
    """Whether two receivers go one way side by side."""
    if len(at) < _LEAST_MARKS or np.median(apart) > _TOGETHER_M:
        return False
    lat, lon = first.lat_rad[at], first.lon_rad[at]
    return bool(np.hypot(np.ptp(lat), np.ptp(lon) * np.cos(lat[0])) * MEAN_RADIUS > _WAY_M)


def _alike(first: Marks, second: Marks, common: int) -> bool:
    """Whether each has all marks of the other, but for one where fixes at an end were not used."""
    least = min(len(first.count), len(second.count))
    if least < _LEAST_MARKS:
        return len(first.count) == len(second.count) == common
    return _holds(first, common) and _holds(second, common)


def _holds(part: Marks | None, common: int) -> bool:
    """Whether all marks of a part are the whole's, but for one where it was cut."""
    return part is not None and common >= len(part.count) - 1


def _sees(mark: Marks | None) -> bool:
    """Whether a run has boxes."""
    return mark is not None and bool(np.any(mark.frame_ns))


def _same_frames(first: Marks, at: IntArray, second: Marks, there: IntArray) -> bool:
    """Whether the boxes are of the same pictures, or one of the two has none."""
    seen, other = first.frame_ns[at], second.frame_ns[there]
    both = (seen != 0) & (other != 0)
    equal = int(np.count_nonzero(seen[both] == other[both]))
    return not both.any() or equal >= max(1.0, _SAME_FRAMES * int(both.sum()))


def sentence(double: Double, part: str, whole: str) -> str:
    """What there is to say of a pair that stays, by the names of its runs."""
    from automap.timebase import gps_to_iso

    when = f"from {gps_to_iso(double.from_s)} to {gps_to_iso(double.to_s)}"
    if double.same:
        return (
            f"{part} and {whole} have the same fixes {when}, whose errors count twice: the map's "
            "sigmas are too small there. Where they are cameras of one vehicle, make one drive of "
            "them; where one log holds another's, cut it out; else give one of them."
        )
    return (
        f"{part} and {whole} went {double.apart_m:.1f} m beside each other {when}, as two "
        "recorders in one vehicle: their errors are taken as independent, and the map's sigmas "
        "may be too small. Give one of them, unless they are two vehicles."
    )
