"""What is to be said of a receiver's log beside its epochs: its messages and its flaws."""

from __future__ import annotations

import numpy as np

from automap import timebase as tb
from automap.earth import MEAN_RADIUS
from automap.io.byte_scan import Scan, key_address, key_is_rtcm, key_is_ubx
from automap.io.epoch_fix_type import GGA_FIX
from automap.io.epoch_join import EARLIEST_GPS_S, Joined
from automap.io.nmea import NmeaTable
from automap.io.ubx_names import message_name
from automap.records import BoolArray, Fixes, FixType

_EARLY_GPS_S = 1564.0 * tb.WEEK_S
"""Start of 2010, from when on phones have gyros. Chosen: receivers of a past era date drives until
August 2029 before it."""
_MANUAL, _SIMULATED = 7, 8
"""Qualities of GGA: typed in by hand; made by a simulator."""


def manual_positions(nmea: dict[str, NmeaTable]) -> BoolArray:
    """Which GGA sentences [n] call their position typed in by hand."""
    gga = nmea.get("GGA")
    return np.zeros(0, np.bool_) if gga is None else np.asarray(gga["quality"] == _MANUAL)


def _kind_name(key: int) -> str:
    if key_is_ubx(key):
        return message_name(key)
    return f"RTCM3-{key & 0xFFF}" if key_is_rtcm(key) else f"NMEA-{key_address(key)}"


def message_counts(scan: Scan) -> dict[str, int]:
    """How many messages of each name a stream has."""
    counts: dict[str, int] = {}
    for kind, key in enumerate(scan.keys):
        name = _kind_name(key) + ("" if scan.verified[kind] else " without checksum")
        counts[name] = counts.get(name, 0) + scan.count(kind)
    return counts


def cut_text(scan: Scan, leave: list[int]) -> str | None:
    """What the end of the stream cut off, as a sentence; None when it ends with a message."""
    if scan.cut_offset < 0:
        last = len(scan) - 1
        if last < 0 or int(scan.kind[last]) not in leave:
            return None
        return (
            f"the file ends inside a sentence at byte {scan.offset[last]} (its checksum is missing)"
        )
    start = scan.data[scan.cut_offset : scan.cut_offset + 16].tobytes()
    present = len(scan.data) - scan.cut_offset
    if start.startswith(b"\xb5\x62") and len(start) >= 4:
        what = message_name(start[2] * 256 + start[3])
    elif start.startswith(b"$"):
        what = "the sentence " + start.split(b",")[0].decode("ascii", "replace")
    else:
        what = "a message"
    missing = f", at least {scan.cut_missing} missing" if scan.cut_missing else ""
    return f"the file ends inside {what} at byte {scan.cut_offset} ({present} bytes of it{missing})"


def stream_warnings(
    scan: Scan, short: dict[str, int], use: list[int], leave: list[int], truncated: str | None
) -> list[str]:
    """On a stream: ``short`` messages by name, the kinds that are read (``use``) and not
    (``leave``), and what its end cut off."""
    warnings = []
    if scan.bad_ubx + scan.bad_nmea:
        warnings.append(
            f"{scan.bad_ubx} UBX and {scan.bad_nmea} NMEA messages have a wrong checksum "
            "and are left out"
        )
    if scan.garbage_bytes:
        share = 100.0 * scan.garbage_bytes / len(scan.data)
        warnings.append(f"{scan.garbage_bytes} bytes ({share:.2g} %) belong to no message")
    for name, count in short.items():
        warnings.append(f"{count} {name} messages are shorter than any known version")
    accepted = sum(scan.count(k) for k in use if not scan.verified[k])
    if accepted:
        warnings.append(f"{accepted} sentences carry no checksum and are taken as they are")
    left = sum(scan.count(k) for k in leave)
    if left:
        warnings.append(f"{left} sentences lack the checksum that others have and are left out")
    if truncated:
        warnings.append(truncated)
    return warnings


def join_warnings(joined: Joined, fixes: Fixes) -> list[str]:
    """On what became of messages when they were joined to epochs."""
    warnings = []
    if joined.no_navigation:
        warnings.append(
            f"{joined.no_navigation} epochs have a time but no message with a position or velocity"
        )
    if joined.untimed:
        warnings.append(f"{joined.untimed} messages belong to no epoch, having no readable time")
    start = float(np.nanmin(fixes.gps_s)) if len(fixes) else np.nan
    if joined.moved_eras:
        first = tb.gps_to_iso(start) if len(fixes) else "unknown"
        warnings.append(
            "the receiver's date lies in a past era of the ten-bit week and is moved on by "
            f"1024 weeks: the log starts at {first}"
        )
    elif EARLIEST_GPS_S <= start < _EARLY_GPS_S:
        warnings.append(
            f"the log starts at {tb.gps_to_iso(start)}: a receiver that has lost the era of its "
            f"ten-bit week says so of {tb.gps_to_iso(start + tb.ROLLOVER_S)[:10]}, 1024 weeks on; "
            "if the drive is of then, dates of the map are as wrong: give the log its right ones"
        )
    if joined.redated:
        warnings.append(
            f"{joined.redated} messages tell another date than those beside them, though the "
            "time of day goes on; they get that of the others"
        )
    return warnings


def epoch_warnings(fixes: Fixes) -> list[str]:
    """On epochs without a position and on their times."""
    warnings = []
    n = len(fixes)
    without = int(np.count_nonzero(fixes.fix_type == FixType.NONE))
    if without:
        warnings.append(f"{without} of {n} epochs have no valid position")
    steps = np.diff(fixes.gps_s)
    back = np.flatnonzero(steps < 0.0)
    if len(back):
        warnings.append(
            f"time runs backwards {len(back)} times, first by {-steps[back[0]]:.3f} s "
            f"at byte {fixes.offset[back[0] + 1]}"
        )
    repeated = steps == 0.0
    if repeated.any():
        north, east = np.diff(fixes.lat_rad), np.diff(fixes.lon_rad) * np.cos(fixes.lat_rad[1:])
        off = MEAN_RADIUS * np.hypot(north, east)[repeated]
        text = f"{len(off)} epochs repeat the time of the one before"
        if np.isfinite(off).any():
            text += f", {np.nanmedian(off):.2g} m off; keep the messages of one receiver"
        warnings.append(text)
    return warnings


def quality_warnings(nmea: dict[str, NmeaTable]) -> list[str]:
    """On positions that are no fixes."""
    warnings = []
    gga = nmea.get("GGA")
    if gga is not None:
        quality = gga["quality"]
        simulated = np.count_nonzero(quality == _SIMULATED)
        manual = np.count_nonzero(manual_positions(nmea))
        if simulated:
            warnings.append(f"{simulated} GGA positions come from a simulator by their own word")
        unknown = np.count_nonzero(quality >= len(GGA_FIX))
        if unknown:
            warnings.append(
                f"{unknown} GGA positions have a quality that no kind of fix has; they are taken "
                "as plain fixes"
            )
        if manual:
            warnings.append(
                f"{manual} GGA positions were typed in by hand (quality 7) and are not used; where "
                'they were measured all the same, write accept = ["gnss_quality"] at the top of '
                "drive.toml"
            )
    return warnings
