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

from automap.io import nmea_kernel as nk
from automap.io.byte_scan import Scan, key_address, key_is_rtcm, key_is_ubx, scan_bytes
from automap.io.scan_kernel import Bytes
from automap.records import IntArray

NmeaTable = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class Sentence:
    """Fields of a sentence type after its address: (column, what it is)."""

    fields: tuple[tuple[str, int], ...]


def _fields(text: str) -> Sentence:
    """Fields from words ``name`` (a number), ``name:kind`` or ``-`` (passed over).

    Kinds: t time of day in s, a angle ddmm.mm in deg, s side letter that gives the sign of the
    angle before it, x text, h hexadecimal number.
    """
    kinds = {"t": nk.TIME, "a": nk.ANGLE, "s": nk.SIDE, "x": nk.TEXT, "h": nk.HEX}
    fields = []
    for word in text.split():
        name, _, kind = word.partition(":")
        fields.append(("", nk.SKIP) if name == "-" else (name, kinds.get(kind, nk.NUMBER)))
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


def sentence_type(address: str) -> tuple[str, str]:
    """Sentence type and talker of an address: ``GNGGA`` is (``GGA``, ``GN``)."""
    if address.startswith("PUBX"):
        return address, "PU"
    return (address[2:], address[:2]) if len(address) == 5 else (address, "")


def decode_sentences(
    scan: Scan, rows: IntArray, layout: Sentence
) -> tuple[NmeaTable, npt.NDArray[np.int32]]:
    """Columns of the sentences ``rows`` [m], all of one type, and how many fields [m] each has.

    A side letter is applied to its angle and has no column of its own.
    """
    names: list[str] = []
    ops = np.zeros(len(layout.fields), np.int8)
    columns = np.zeros(len(layout.fields), np.int64)
    missing = np.full(len(layout.fields), np.nan)
    for k, (name, op) in enumerate(layout.fields):
        ops[k] = op
        if op == nk.SIDE:
            columns[k] = len(names) - 1
        elif op != nk.SKIP:
            columns[k] = len(names)
            names.append(name)
            if op == nk.TEXT:
                missing[k] = 0.0
    out = np.empty((len(names), len(rows)))
    n_fields = np.empty(len(rows), np.int32)
    nk.decode_kernel.run(
        len(scan.data),
        scan.data,
        scan.offset[rows],
        ops,
        columns,
        missing,
        nk.POWERS,
        out,
        n_fields,
    )
    return dict(zip(names, out, strict=True)), n_fields


def _move_signal_id(
    scan: Scan, rows: IntArray, table: NmeaTable, n_fields: npt.NDArray[np.int32]
) -> None:
    """In a GSV sentence with fewer than four satellites the signal id stands earlier."""
    for satellites in range(4):
        place = _GSV_FIXED + 4 * satellites
        short = np.flatnonzero(n_fields == place + 1)
        if len(short) == 0:
            continue
        layout = Sentence((("", nk.SKIP),) * place + (("signalID", nk.HEX),))
        again, _ = decode_sentences(scan, rows[short], layout)
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
        talkers = np.full(len(scan.keys), "", "U2")
        for kind, talker in members:
            talkers[kind] = talker
        if len(members) == 1:
            rows = scan.rows(members[0][0])
        else:
            among = np.zeros(len(scan.keys), bool)
            among[[kind for kind, _ in members]] = True
            rows = np.flatnonzero(among[scan.kind])
        table, n_fields = decode_sentences(scan, rows, SENTENCES[name])
        if name == "GSV":
            _move_signal_id(scan, rows, table, n_fields)
        tables[name] = {"offset": scan.offset[rows], "talker": talkers[scan.kind[rows]], **table}
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
