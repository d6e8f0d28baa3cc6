"""What kind of fix an epoch is, by the message that knows best."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from automap.io.epoch_source import Epochs, Source, among, select
from automap.io.nmea import pack_text
from automap.records import BoolArray, FixType

Kinds = npt.NDArray[np.uint8]

_ORDER = (
    "NAV-PVT",
    "NAV-SOL",
    "NAV-STATUS",
    "GGA",
    "GNS",
    "PUBX00",
    "RMC",
    "GLL",
    "NAV-HPPOSLLH",
    "NAV-POSLLH",
)

GGA_FIX = np.array(
    [
        FixType.NONE,
        FixType.THREE_D,
        FixType.DGNSS,
        FixType.THREE_D,
        FixType.FIXED,
        FixType.FLOAT,
        FixType.DEAD_RECKONING,
        FixType.NONE,  # typed in by hand
        FixType.THREE_D,  # simulator
        FixType.DGNSS,
    ],
    np.uint8,
)
"""Kinds of fixes by the quality that NMEA's GGA tells (NMEA 0183, version 4.1)."""

_PUBX_FIX = {
    "DR": FixType.DEAD_RECKONING,
    "G2": FixType.TWO_D,
    "G3": FixType.THREE_D,
    "D2": FixType.TWO_D,
    "D3": FixType.DGNSS,
    "RK": FixType.THREE_D,
}

_MODE_FIX = {
    "A": FixType.THREE_D,
    "D": FixType.DGNSS,
    "P": FixType.DGNSS,
    "F": FixType.FLOAT,
    "R": FixType.FIXED,
    "E": FixType.DEAD_RECKONING,
    "S": FixType.THREE_D,
}


def fix_types(sources: dict[str, Source], n: int) -> Kinds:
    """Values of FixType [n] of the epochs; whether there is a position is not looked at."""
    fix = np.full(n, FixType.NONE, np.uint8)
    open_ = np.ones(n, bool)
    for name in _ORDER:
        if name in sources:
            mask = open_ & sources[name].has
            if mask.any():
                epochs = select(mask)
                fix[epochs] = _fix_of(sources[name], epochs)
                open_[epochs] = False
    nmea_says = np.zeros(n, bool)
    for name in ("GGA", "GNS", "PUBX00", "RMC", "GLL"):
        if name in sources:
            nmea_says |= sources[name].has
    for name in ("NAV-PVT", "NAV-SOL", "NAV-STATUS"):
        if name in sources:
            nmea_says &= ~sources[name].has
    if not nmea_says.any():
        return fix
    if "RMC" in sources:
        # a receiver may still give coordinates in GGA while it warns in RMC
        epochs = select(nmea_says & sources["RMC"].has)
        warned = sources["RMC"].value("status", epochs) == ord("V")
        if warned.any():
            fix[among(epochs, warned)] = FixType.NONE
    if "GSA" in sources:
        epochs = select(nmea_says & sources["GSA"].has)
        flat = sources["GSA"].value("navMode", epochs) == 2
        flat &= is_spatial(fix[epochs])
        if flat.any():
            fix[among(epochs, flat)] = FixType.TWO_D
    return fix


def is_spatial(fix: Kinds) -> BoolArray:
    """Whether each kind [n] is a code fix in three dimensions."""
    return np.asarray((fix == FixType.THREE_D) | (fix == FixType.DGNSS))


def _ubx_table(carrier: bool) -> Kinds:
    """FixType for each u-blox fix number (0 to 5) times 256 plus flags.

    The numbers are 1 dead reckoning, 2 2D, 3 3D, 4 both; 0 and 5 are none. Flags: bit 0 the
    fix is good, bit 1 differential, and with ``carrier`` bits 6 and 7 its solution.
    """
    kind, flags = np.divmod(np.arange(6 * 256), 256)
    fix = np.array([FixType.NONE, 1, 2, 3, 3, FixType.NONE], np.uint8)[kind]
    fix[(fix == FixType.THREE_D) & (flags & 2 != 0)] = FixType.DGNSS
    fix[flags & 1 == 0] = FixType.NONE
    if carrier:
        spatial = is_spatial(fix)
        fix[spatial & (flags >> 6 == 1)] = FixType.FLOAT
        fix[spatial & (flags >> 6 == 2)] = FixType.FIXED
    return fix


def _mode_table() -> Kinds:
    """FixType for each code of an NMEA mode letter, at 256 for anything else."""
    fix = np.full(257, FixType.THREE_D, np.uint8)
    for letter, kind in _MODE_FIX.items():
        fix[ord(letter)] = kind
    return fix


def _fix_of(source: Source, epochs: Epochs) -> Kinds:
    name = source.name
    if name in ("NAV-PVT", "NAV-SOL", "NAV-STATUS"):
        pvt = name == "NAV-PVT"
        number = np.minimum(source.counts("fixType" if pvt else "gpsFix", epochs), 5)
        place = number.astype(np.int16) * 256 + source.counts("flags", epochs)
        fix = np.asarray(_ubx_table(carrier=pvt)[place], np.uint8)
        if pvt:
            invalid = source.counts("flags3", epochs) & 1 != 0
            fix[invalid] = FixType.NONE
        return fix
    if name == "GGA":
        # fmax gives 0 for NaN
        quality = np.fmax(source.value("quality", epochs), 0.0)
        known = quality < len(GGA_FIX)
        told = GGA_FIX[np.where(known, quality, 0.0).astype(np.int8)]
        return np.asarray(np.where(known, told, FixType.THREE_D), np.uint8)
    if name == "PUBX00":
        status = source.value("navStat", epochs)
        fix = np.full(len(status), FixType.NONE, np.uint8)
        for text, kind in _PUBX_FIX.items():
            fix[status == pack_text(text)] = kind
        # the combined and the time-only solution are written in other letters by some firmware
        return fix
    if name == "GNS":
        mode = source.value("posMode", epochs).astype(np.int64)
        fix = np.full(len(mode), FixType.NONE, np.uint8)
        for letter, kind in sorted(_MODE_FIX.items(), key=lambda item: item[1]):
            for byte in range(6):
                fix[(mode >> (8 * byte)) & 255 == ord(letter)] = kind
        return fix
    if name in ("RMC", "GLL"):
        letter_code = np.fmin(source.value("posMode", epochs), 256.0).astype(np.int16)
        fix = np.asarray(_mode_table()[letter_code], np.uint8)
        fix[source.value("status", epochs) != ord("A")] = FixType.NONE
        return fix
    # a position that says nothing of its validity: u-blox reports a huge accuracy without a fix
    ok = source.value("hAcc", epochs) < 1e5
    if name == "NAV-HPPOSLLH":
        ok &= source.counts("flags", epochs) & 1 == 0
    return np.where(ok, FixType.THREE_D, FixType.NONE).astype(np.uint8)
