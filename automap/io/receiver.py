"""Receiver logs of any kind, told apart by their content."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from automap import timebase as tb
from automap.errors import AutoMapError, InputError
from automap.io import nmea as nmea_format
from automap.io import rtklib
from automap.io import ubx as ubx_format
from automap.io.byte_scan import Scan, key_address, key_is_rtcm, key_is_ubx, scan_bytes
from automap.io.cut_times import uncut_times
from automap.io.epoch_fixes import build_fixes, take_once
from automap.io.epoch_join import EARLIEST_GPS_S, Joined, join_epochs
from automap.io.esf import ReceiverImu, read_esf
from automap.io.fix_table import RowStamps, read_fix_table
from automap.io.gpx import decode_gpx, looks_like_gpx
from automap.io.named_table import look_at_table
from automap.io.nmea import NmeaTable
from automap.io.receiver_told import (
    cut_text,
    epoch_warnings,
    join_warnings,
    manual_positions,
    message_counts,
    quality_warnings,
    stream_warnings,
)
from automap.io.table_form import TableForm
from automap.io.ubx import Table
from automap.records import NO_TIME, Fixes

_SNIFF_BYTES = 1 << 20
_TABLE_SUFFIXES = (".csv", ".tsv", ".tab")
_PLAIN_FIX = 1
"""Quality of GGA: a fix without corrections."""
_CONTENT = re.compile(rb"[^ \t\r\n\0]")


@dataclass(frozen=True)
class ReceiverLog:
    """What a receiver log holds.

    ``fixes`` one row an epoch, without arrival times; ``imu`` the receiver's own inertial
    sensors. ``messages`` counts by name ("UBX-NAV-PVT", "NMEA-GNGGA", "UBX-0x27-0x03").
    ``garbage_bytes`` belong to no message (blank and ``#`` lines apart); ``truncated`` says
    what the end of the file cut off. ``kind`` is "ubx", "nmea", "mixed", "rtklib" or "gpx".
    ``ubx`` and ``nmea`` are the decoded tables by type. ``notes`` say how a table of fixes
    (``kind`` "table") was understood. ``period_s`` where no date is told: times are known within
    a day (UTC) or a week (GPS time) then, and count from the first one of 1980.
    """

    fixes: Fixes
    imu: ReceiverImu | None
    messages: dict[str, int]
    bad_checksums: int
    garbage_bytes: int
    truncated: str | None
    warnings: list[str]
    kind: str
    ubx: dict[str, Table] = field(default_factory=dict)
    nmea: dict[str, NmeaTable] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    period_s: float | None = None


def sniff(data: bytes) -> str | None:
    """Kind of a log by its content: ubx, nmea, mixed, rtklib, gpx; None when it is none of them."""
    if rtklib.looks_like_pos(data):
        return "rtklib"
    if looks_like_gpx(data):
        return "gpx"
    # each sentence and each packet begins so: a table has neither
    if b"$" not in data and b"\xb5b" not in data:
        return None
    kind = _stream_kind(scan_bytes(data[:_SNIFF_BYTES]))
    if kind is None and len(data) > _SNIFF_BYTES:
        kind = _stream_kind(scan_bytes(data))
    return kind


def read_receiver_log(
    path: Path,
    not_before_gps_s: float = EARLIEST_GPS_S,
    form: TableForm | None = None,
    written: RowStamps | None = None,
    accept_manual: bool = False,
) -> ReceiverLog:
    """Read a u-blox, NMEA, mixed or RTKLIB log, a GPX track, or a table of fixes.

    ``not_before_gps_s``: dates before it are taken for ones of a past 1024-week era and moved.
    ``accept_manual``: GGA positions of quality 7 (typed in by hand) are fixes; programs of phones
    write it of their own. ``form`` and ``written`` are for tables, see
    :func:`automap.io.fix_table.read_fix_table`.
    Raises InputError when the file cannot be read, is empty, or holds no message that this
    reader knows and can use.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if (form is not None and form.columns) or _is_table(path, data):
        return _read_table(path, form, written)
    return read_receiver_bytes(data, str(path), not_before_gps_s, accept_manual)


def _is_table(path: Path, data: bytes) -> bool:
    """Whether a file is none of the logs, and text in columns or called so."""
    if _CONTENT.search(data) is None or sniff(data) is not None:
        return False
    if path.suffix.lower() in _TABLE_SUFFIXES:
        return True
    try:
        look_at_table(path, "gnss")
    except AutoMapError:
        return False
    return True


def _read_table(path: Path, form: TableForm | None, written: RowStamps | None) -> ReceiverLog:
    table = read_fix_table(path, form, written)
    return ReceiverLog(
        fixes=table.fixes,
        imu=None,
        messages={"rows of the table": table.rows}
        | ({"rows that repeat a fix": table.held} if table.held else {}),
        bad_checksums=0,
        garbage_bytes=0,
        truncated=None,
        warnings=[text.removeprefix(f"{path}: ") for text in table.warnings],
        kind="table",
        notes=table.notes,
        period_s=table.period_s,
    )


def read_receiver_bytes(
    data: bytes,
    name: str,
    not_before_gps_s: float = EARLIEST_GPS_S,
    accept_manual: bool = False,
) -> ReceiverLog:
    """As :func:`read_receiver_log`, of bytes; ``name`` stands for the file in messages."""
    if _CONTENT.search(data) is None:
        raise InputError(f"{name} is empty; record the receiver's output again")
    if rtklib.looks_like_pos(data):
        return _read_rtklib(data, name)
    if looks_like_gpx(data):
        return _read_gpx(data, name)
    scan = scan_bytes(data)
    kind = _stream_kind(scan)
    if kind is None:
        found = scan.bad_nmea + scan.bad_ubx
        why = f"; all {found} message starts have a wrong checksum" if found else ""
        raise InputError(
            f"{name}: no UBX, NMEA or RTKLIB content in its {len(data)} bytes{why}; "
            "check that this is the receiver's raw output (and the baud rate it was taken with)"
        )
    return _read_stream(scan, kind, name, not_before_gps_s, accept_manual)


def _stream_kind(scan: Scan) -> str | None:
    """Kind of a scanned stream; sentences without checksum count when they are known ones."""
    has_ubx = any(key_is_ubx(key) for key in scan.keys)
    has_nmea = any(
        verified or nmea_format.sentence_type(key_address(key))[0] in nmea_format.SENTENCES
        for key, verified in zip(scan.keys, scan.verified, strict=True)
        if not key_is_ubx(key) and not key_is_rtcm(key)
    )
    if has_ubx and has_nmea:
        return "mixed"
    return "ubx" if has_ubx else "nmea" if has_nmea else None


def _read_rtklib(data: bytes, name: str) -> ReceiverLog:
    fixes, warnings, truncated, bad_rows = rtklib.decode_pos(data, name)
    warnings += epoch_warnings(fixes)
    if truncated:
        warnings.append(truncated)
    return ReceiverLog(
        fixes=fixes,
        imu=None,
        messages={"RTKLIB row": len(fixes)}
        | ({"RTKLIB row not read": bad_rows} if bad_rows else {}),
        bad_checksums=0,
        garbage_bytes=0,
        truncated=truncated,
        warnings=warnings,
        kind="rtklib",
    )


def _read_gpx(data: bytes, name: str) -> ReceiverLog:
    fixes, warnings = decode_gpx(data, name)
    return ReceiverLog(
        fixes=fixes,
        imu=None,
        messages={"GPX track point": len(fixes)},
        bad_checksums=0,
        garbage_bytes=0,
        truncated=None,
        warnings=warnings + epoch_warnings(fixes),
        kind="gpx",
    )


def _read_stream(
    scan: Scan, kind: str, name: str, not_before_gps_s: float, accept_manual: bool
) -> ReceiverLog:
    ubx, short = ubx_format.decode_scan(scan)
    use, leave = nmea_format.sentence_kinds(scan)
    nmea = nmea_format.decode_scan(scan, use)
    manual = manual_positions(nmea)
    if accept_manual and manual.any():
        nmea["GGA"]["quality"][manual] = _PLAIN_FIX
    messages = message_counts(scan)
    joined = join_epochs(ubx, nmea, len(scan.data), not_before_gps_s)
    fixes = build_fixes(joined, ubx, nmea) if joined is not None else _no_fixes()
    fixes, uncut = uncut_times(fixes)
    fixes, again = take_once(fixes)
    imu, warnings = read_esf(ubx, fixes)
    if len(fixes) == 0 and imu is None:
        seen = ", ".join(f"{count} {what}" for what, count in list(messages.items())[:4])
        raise InputError(
            f"{name}: no message with a position or velocity ({seen}); "
            "switch on NAV-PVT or GGA and RMC in the receiver, "
            "or solve raw measurements with RTKLIB and give its .pos file"
        )
    truncated = cut_text(scan, leave)
    warnings += stream_warnings(scan, short, use, leave, truncated)
    if joined is not None:
        warnings += join_warnings(joined, fixes)
    warnings += [] if uncut is None else [uncut]
    if again:
        warnings.append(f"{again} epochs tell time and place of the one before again; left out")
    warnings += epoch_warnings(fixes)
    warnings += quality_warnings(nmea)
    if accept_manual and manual.any():
        count = np.count_nonzero(manual)
        warnings.append(f"{count} GGA positions of quality 7 (typed in by hand) are used")
    return ReceiverLog(
        fixes=fixes,
        imu=imu,
        messages=messages,
        bad_checksums=scan.bad_ubx + scan.bad_nmea,
        garbage_bytes=scan.garbage_bytes,
        truncated=truncated,
        warnings=warnings,
        kind=kind,
        ubx=ubx,
        nmea=nmea,
        period_s=_period_s(joined),
    )


def _period_s(joined: Joined | None) -> float | None:
    if joined is None or joined.dated:
        return None
    return float(tb.WEEK_S if any(name.startswith("NAV-") for name in joined.rows) else tb.DAY_S)


def _no_fixes() -> Fixes:
    none = np.zeros(0)
    rows = np.zeros((0, 3))
    whole = np.zeros(0, np.int64)
    return Fixes(
        gps_s=none,
        lat_rad=none,
        lon_rad=none,
        height_m=none,
        vel_ned=rows,
        sd_pos_ned=rows,
        sd_vel_ned=rows,
        fix_type=whole,
        n_sats=whole,
        hdop=none,
        geoid_sep_m=none,
        offset=whole,
        arrival_ns=np.full(0, NO_TIME, np.int64),
    )
