"""Layouts of the UBX messages that are decoded.

References: u-blox 5 receiver protocol specification (GPS.G5-X-07036), u-blox 8/M8 receiver
description (UBX-13003221), u-blox F9 HPG 1.32 interface description (UBX-22008968).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Layout:
    """Payload of one message of fixed length.

    ``fields`` are (name, numpy type, physical unit per count); ``shortest`` is the least
    payload length that older firmware sent, what it lacks reads as zero.
    """

    key: int
    fields: tuple[tuple[str, str, float], ...]
    shortest: int = 0

    @property
    def size(self) -> int:
        """Bytes of the payload."""
        return int(self.dtype.itemsize)

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Packed numpy type of the payload."""
        return np.dtype([(name, "<" + kind) for name, kind, _ in self.fields])


def _layout(key: int, text: str, shortest: int = 0) -> Layout:
    """A layout from lines ``name type [scale]``."""
    fields = []
    for line in text.strip().splitlines():
        name, kind, *scale = line.split()
        fields.append((name, kind, float(scale[0]) if scale else 1.0))
    return Layout(key, tuple(fields), shortest)


LAYOUTS = {
    "NAV-POSLLH": _layout(
        0x0102,
        """iTOW u4 1e-3
        lon i4 1e-7
        lat i4 1e-7
        height i4 1e-3
        hMSL i4 1e-3
        hAcc u4 1e-3
        vAcc u4 1e-3""",
    ),
    "NAV-STATUS": _layout(
        0x0103,
        """iTOW u4 1e-3
        gpsFix u1
        flags u1
        fixStat u1
        flags2 u1
        ttff u4 1e-3
        msss u4 1e-3""",
    ),
    "NAV-DOP": _layout(
        0x0104,
        """iTOW u4 1e-3
        gDOP u2 1e-2
        pDOP u2 1e-2
        tDOP u2 1e-2
        vDOP u2 1e-2
        hDOP u2 1e-2
        nDOP u2 1e-2
        eDOP u2 1e-2""",
    ),
    "NAV-SOL": _layout(
        0x0106,
        """iTOW u4 1e-3
        fTOW i4 1e-9
        week i2
        gpsFix u1
        flags u1
        ecefX i4 1e-2
        ecefY i4 1e-2
        ecefZ i4 1e-2
        pAcc u4 1e-2
        ecefVX i4 1e-2
        ecefVY i4 1e-2
        ecefVZ i4 1e-2
        sAcc u4 1e-2
        pDOP u2 1e-2
        reserved1 u1
        numSV u1
        reserved2 u4""",
    ),
    "NAV-PVT": _layout(
        0x0107,
        """iTOW u4 1e-3
        year u2
        month u1
        day u1
        hour u1
        min u1
        second u1
        valid u1
        tAcc u4 1e-9
        nano i4 1e-9
        fixType u1
        flags u1
        flags2 u1
        numSV u1
        lon i4 1e-7
        lat i4 1e-7
        height i4 1e-3
        hMSL i4 1e-3
        hAcc u4 1e-3
        vAcc u4 1e-3
        velN i4 1e-3
        velE i4 1e-3
        velD i4 1e-3
        gSpeed i4 1e-3
        headMot i4 1e-5
        sAcc u4 1e-3
        headAcc u4 1e-5
        pDOP u2 1e-2
        flags3 u2
        reserved0 u4
        headVeh i4 1e-5
        magDec i2 1e-2
        magAcc u2 1e-2""",
        shortest=84,
    ),
    "NAV-VELNED": _layout(
        0x0112,
        """iTOW u4 1e-3
        velN i4 1e-2
        velE i4 1e-2
        velD i4 1e-2
        speed u4 1e-2
        gSpeed u4 1e-2
        heading i4 1e-5
        sAcc u4 1e-2
        cAcc u4 1e-5""",
    ),
    "NAV-HPPOSLLH": _layout(
        0x0114,
        """version u1
        reserved0 u2
        flags u1
        iTOW u4 1e-3
        lon i4 1e-7
        lat i4 1e-7
        height i4 1e-3
        hMSL i4 1e-3
        lonHp i1 1e-9
        latHp i1 1e-9
        heightHp i1 1e-4
        hMSLHp i1 1e-4
        hAcc u4 1e-4
        vAcc u4 1e-4""",
    ),
    "NAV-TIMEGPS": _layout(
        0x0120,
        """iTOW u4 1e-3
        fTOW i4 1e-9
        week i2
        leapS i1
        valid u1
        tAcc u4 1e-9""",
    ),
    "NAV-TIMEUTC": _layout(
        0x0121,
        """iTOW u4 1e-3
        tAcc u4 1e-9
        nano i4 1e-9
        year u2
        month u1
        day u1
        hour u1
        min u1
        sec u1
        valid u1""",
    ),
    "NAV-COV": _layout(
        0x0136,
        """iTOW u4 1e-3
        version u1
        posCovValid u1
        velCovValid u1
        reserved0 u1
        reserved1 u4
        reserved2 u4
        posCovNN f4
        posCovNE f4
        posCovND f4
        posCovEE f4
        posCovED f4
        posCovDD f4
        velCovNN f4
        velCovNE f4
        velCovND f4
        velCovEE f4
        velCovED f4
        velCovDD f4""",
    ),
    "NAV-EOE": _layout(0x0161, "iTOW u4 1e-3"),
}
