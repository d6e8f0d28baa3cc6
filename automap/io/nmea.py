"""NMEA 0183 sentences: fields, numbers, and decoding into columns without a Python loop.

Each sentence type becomes a table: a mapping from column name to an array [m], one row a
sentence whatever its talker. Numbers are float64 (NaN where the field is empty or no
number); one-letter fields hold the character's code, mode strings up to six characters
packed big-endian (0 where empty). ``offset`` is the byte offset of the sentence, ``talker``
its two-letter talker.

References: NMEA 0183 v4.11; u-blox M9 interface description (UBX-19035940), 2 (NMEA) for
the PUBX sentences.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from automap.io.byte_scan import Bytes, Scan, key_address, key_is_rtcm, key_is_ubx, scan_bytes
from automap.records import FloatArray, IntArray

NmeaTable = dict[str, npt.NDArray[Any]]

_SKIP, _NUMBER, _TIME, _ANGLE, _SIDE, _TEXT, _HEX = range(7)


@dataclass(frozen=True)
class Sentence:
    """Fields of a sentence type after its address: (column, what it is)."""

    fields: tuple[tuple[str, int], ...]


def _fields(text: str) -> Sentence:
    """Fields from words ``name`` (a number), ``name:kind`` or ``-`` (passed over).

    Kinds: t time of day in s, a angle ddmm.mm in deg, s side letter that gives the sign of the
    angle before it, x text, h hexadecimal number.
    """
    kinds = {"t": _TIME, "a": _ANGLE, "s": _SIDE, "x": _TEXT, "h": _HEX}
    fields = []
    for word in text.split():
        name, _, kind = word.partition(":")
        fields.append(("", _SKIP) if name == "-" else (name, kinds.get(kind, _NUMBER)))
    return Sentence(tuple(fields))


_SATS = " ".join(f"svid_{i} elv_{i} az_{i} cno_{i}" for i in range(1, 5))

SENTENCES = {
    "GGA": _fields(
        "time:t lat:a NS:s lon:a EW:s quality numSV HDOP alt altUnit:x sep sepUnit:x "
        "diffAge diffStation"
    ),
    "RMC": _fields(
        "time:t status:x lat:a NS:s lon:a EW:s spd cog date mv mvEW:x posMode:x navStatus:x"
    ),
    "VTG": _fields("cogt cogtUnit:x cogm cogmUnit:x sogn sognUnit:x sogk sogkUnit:x posMode:x"),
    "GSA": _fields(
        "opMode:x navMode "
        + " ".join(f"svid_{i}" for i in range(1, 13))
        + " PDOP HDOP VDOP systemId:h"
    ),
    "GST": _fields("time:t rangeRms stdMajor stdMinor orient stdLat stdLong stdAlt"),
    "GSV": _fields(f"numMsg msgNum numSV {_SATS} signalID:h"),
    "ZDA": _fields("time:t day month year ltzh ltzn"),
    "GNS": _fields(
        "time:t lat:a NS:s lon:a EW:s posMode:x numSV HDOP alt sep diffAge diffStation navStatus:x"
    ),
    "GLL": _fields("lat:a NS:s lon:a EW:s time:t status:x posMode:x"),
    "PUBX00": _fields(
        "- time:t lat:a NS:s lon:a EW:s altRef navStat:x hAcc vAcc SOG COG vVel diffAge HDOP "
        "VDOP TDOP numSVs reserved DR"
    ),
}
"""Sentence types that are decoded; the columns are named as pynmeagps names them."""

_GSV_FIXED = 3


_POWERS = np.asarray([10**k for k in range(19)], np.int64)


@njit(cache=True)
def _decode_kernel(
    data: Bytes,
    offset: IntArray,
    length: npt.NDArray[np.int32],
    ops: npt.NDArray[np.int8],
    columns: IntArray,
    powers: IntArray,
    out: FloatArray,
    n_fields: npt.NDArray[np.int32],
) -> None:
    """Split each sentence at its commas and read field k as ``ops[k]`` into ``out[columns[k]]``.

    ``out`` [c, m] is NaN beforehand, 0 in text columns. ``n_fields`` [m] counts the fields
    that the sentence has after its address. A number is read as an integer of up to 18 digits
    and a power of ten; their quotient is the nearest float64 up to 15 digits, as every
    receiver's number has.
    """
    n_ops = len(ops)
    for row in range(len(offset)):
        i = offset[row]
        stop = i + length[row]
        while data[i] != 44:
            i += 1
        i += 1
        k = 0
        while True:
            start = i
            mantissa = 0
            digits = 0
            decimals = 0
            dropped = 0
            point = False
            number = True
            while i < stop:
                c = data[i]
                digit = int(c) - 48
                if 0 <= digit <= 9:
                    if digits < 18:
                        mantissa = mantissa * 10 + digit
                        digits += 1
                        if point:
                            decimals += 1
                    elif not point:
                        dropped += 1
                elif c == 44 or c == 42 or c == 13 or c == 10:
                    break
                elif c == 46 and not point:
                    point = True
                elif not (c == 45 and i == start):
                    number = False
                i += 1
            if k < n_ops and i > start and ops[k] != 0:
                op = ops[k]
                column = columns[k]
                scale = powers[decimals]
                if op == 1:
                    if number and digits > 0:
                        value = float(mantissa)
                        if decimals > 0:
                            value /= float(scale)
                        if dropped > 0:
                            value *= 10.0**dropped
                        out[column, row] = -value if data[start] == 45 else value
                elif op == 2:
                    if number and digits >= 6 and data[start] != 45:
                        hours = mantissa // (10000 * scale)
                        mantissa -= hours * 10000 * scale
                        minutes = mantissa // (100 * scale)
                        seconds = float(mantissa - minutes * 100 * scale) / float(scale)
                        if hours < 24 and minutes < 60 and seconds < 61.0:
                            out[column, row] = float(hours * 3600 + minutes * 60) + seconds
                elif op == 3:
                    if number and digits - decimals >= 3 and decimals <= 13 and dropped == 0:
                        degrees = mantissa // (100 * scale)
                        minute = float(mantissa - degrees * 100 * scale) / float(scale)
                        if degrees <= 180 and minute < 60.0 and data[start] != 45:
                            out[column, row] = float(degrees) + minute / 60.0
                elif op == 4:
                    if data[start] == 83 or data[start] == 87:
                        out[column, row] = -out[column, row]
                    elif data[start] != 78 and data[start] != 69:
                        out[column, row] = np.nan
                elif op == 5:
                    packed = 0
                    for j in range(start, min(i, start + 6)):
                        packed = packed * 256 + int(data[j])
                    out[column, row] = float(packed)
                else:
                    code = 0
                    for j in range(start, min(i, start + 8)):
                        c = data[j]
                        if 48 <= c <= 57:
                            code = code * 16 + (int(c) - 48)
                        elif 65 <= c <= 70 or 97 <= c <= 102:
                            code = code * 16 + ((int(c) & 7) + 9)
                        else:
                            code = -1
                            break
                    if code >= 0:
                        out[column, row] = float(code)
            k += 1
            if i >= stop or data[i] != 44:
                break
            i += 1
        n_fields[row] = k


def sentence_type(address: str) -> tuple[str, str]:
    """Sentence type and talker of an address: ``GNGGA`` is (``GGA``, ``GN``)."""
    if address.startswith("PUBX"):
        return address, "PU"
    return (address[2:], address[:2]) if len(address) == 5 else (address, "")


def decode_sentences(
    data: Bytes, offset: IntArray, length: npt.NDArray[np.int32], layout: Sentence
) -> tuple[NmeaTable, IntArray]:
    """Columns of sentences of one type, and the number of fields [m] of each sentence.

    A side letter is applied to its angle and has no column of its own.
    """
    names: list[str] = []
    ops = np.zeros(len(layout.fields), np.int8)
    columns = np.zeros(len(layout.fields), np.int64)
    text: list[bool] = []
    for k, (name, op) in enumerate(layout.fields):
        ops[k] = op
        if op == _SIDE:
            columns[k] = len(names) - 1
        elif op != _SKIP:
            columns[k] = len(names)
            names.append(name)
            text.append(op == _TEXT)
    out = np.empty((len(names), len(offset)))
    out[:] = np.where(text, 0.0, np.nan)[:, None]
    n_fields = np.zeros(len(offset), np.int32)
    _decode_kernel(data, offset, length, ops, columns, _POWERS, out, n_fields)
    return dict(zip(names, out, strict=True)), n_fields.astype(np.int64)


def _move_signal_id(scan: Scan, rows: IntArray, table: NmeaTable, n_fields: IntArray) -> None:
    """In a GSV sentence with fewer than four satellites the signal id stands earlier."""
    for satellites in range(4):
        place = _GSV_FIXED + 4 * satellites
        short = np.flatnonzero(n_fields == place + 1)
        if len(short) == 0:
            continue
        layout = Sentence((("", _SKIP),) * place + (("signalID", _HEX),))
        messages = rows[short]
        again, _ = decode_sentences(scan.data, scan.offset[messages], scan.length[messages], layout)
        table["signalID"][short] = again["signalID"]
        table[f"svid_{satellites + 1}"][short] = np.nan


def decode_scan(scan: Scan, kinds: list[int]) -> dict[str, NmeaTable]:
    """Tables of the known sentences among ``kinds`` of a scanned stream, by type."""
    groups: dict[str, list[tuple[int, str]]] = {}
    for kind in kinds:
        name, talker = sentence_type(key_address(scan.keys[kind]))
        if name in SENTENCES:
            groups.setdefault(name, []).append((kind, talker))
    tables: dict[str, NmeaTable] = {}
    for name, members in groups.items():
        rows = np.concatenate([scan.rows(kind) for kind, _ in members])
        talkers = np.concatenate(
            [np.full(scan.count(kind), talker, "U2") for kind, talker in members]
        )
        if len(members) > 1:
            order = np.argsort(rows, kind="stable")
            rows, talkers = rows[order], talkers[order]
        offset = scan.offset[rows]
        table, n_fields = decode_sentences(scan.data, offset, scan.length[rows], SENTENCES[name])
        if name == "GSV":
            _move_signal_id(scan, rows, table, n_fields)
        tables[name] = {"offset": offset, "talker": talkers, **table}
    return tables


def sentence_kinds(scan: Scan) -> tuple[list[int], list[int]]:
    """Kinds of a scan that are NMEA sentences: those to use, and those to leave.

    A sentence without a checksum is used only where the log never gives its type one: in a
    log that has checksums, a sentence that lost its own is a damaged one.
    """
    nmea = [k for k, key in enumerate(scan.keys) if not key_is_ubx(key) and not key_is_rtcm(key)]
    checked = {scan.keys[k] for k in nmea if scan.verified[k]}
    use = [k for k in nmea if scan.verified[k] or scan.keys[k] not in checked]
    return use, [k for k in nmea if k not in use]


def decode_nmea(data: bytes | Bytes) -> dict[str, NmeaTable]:
    """Tables of every known sentence in a byte stream, by type (``GGA``, ``PUBX00``, ...)."""
    scan = scan_bytes(data)
    return decode_scan(scan, sentence_kinds(scan)[0])


def unpack_text(value: float) -> str:
    """Text of a packed field."""
    number = int(value)
    return number.to_bytes(6, "big").lstrip(b"\0").decode("ascii", "replace")


def pack_text(text: str) -> float:
    """What a text column holds for ``text``."""
    return float(int.from_bytes(text.encode("ascii"), "big"))
