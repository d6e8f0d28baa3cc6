"""Fixes from joined epochs: for every quantity the best message that has it.

UBX goes before NMEA, newer messages before older ones. Accuracy figures become one sigma per
axis: ``hAcc`` is the radius of both horizontal axes together (divided by sqrt 2), ``sAcc`` of
SOL, VELNED and PVT and ``pAcc`` of SOL are of three axes together (divided by sqrt 3);
NAV-COV and GST give each axis and go before the others.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from automap.io.epoch_join import Joined
from automap.io.nmea import NmeaTable, pack_text
from automap.io.ubx import Table, physical
from automap.records import NO_TIME, Fixes, FixType, FloatArray, IntArray

KNOT = 1852.0 / 3600.0

STANDSTILL_SPEED = 0.1
"""Speed (m/s) under which a missing course means standing still and not an unknown velocity;
receivers leave the course out at standstill."""

_GGA_FIX = np.array(
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
    np.int64,
)

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

BoolArray = npt.NDArray[np.bool_]


class _Rows:
    """The messages of one type, addressed by epoch."""

    def __init__(
        self, name: str, joined: Joined, ubx: dict[str, Table], nmea: dict[str, NmeaTable]
    ) -> None:
        self.name = name
        self.row = joined.rows[name]
        self.has: BoolArray = self.row >= 0
        self._ubx = ubx.get(name)
        self._nmea = nmea.get(name)

    def value(self, field: str, epochs: IntArray) -> FloatArray:
        """A field in its unit [k] at epochs [k] that have this type."""
        row = self.row[epochs]
        if self._ubx is not None:
            return physical(self.name, self._ubx, field, row)
        assert self._nmea is not None
        return np.asarray(self._nmea[field][row], np.float64)

    def bits(self, field: str, epochs: IntArray) -> IntArray:
        """An integer field [k] at epochs [k] that have this type."""
        return self.value(field, epochs).astype(np.int64)


def build_fixes(joined: Joined, ubx: dict[str, Table], nmea: dict[str, NmeaTable]) -> Fixes:
    """Fixes of joined epochs, one row each.

    An epoch without a valid position stays as a row of type NONE whose values are NaN.
    """
    n = len(joined.gps_s)
    sources = {name: _Rows(name, joined, ubx, nmea) for name in joined.rows}
    sources = {name: rows for name, rows in sources.items() if rows.has.any()}
    fix_type = _fix_types(sources, n)
    lat, lon, height, sep = (np.full(n, np.nan) for _ in range(4))
    sd_pos = np.full((n, 3), np.nan)
    open_ = fix_type != FixType.NONE
    for name in (
        "NAV-HPPOSLLH",
        "NAV-PVT",
        "NAV-POSLLH",
        "NAV-SOL",
        "PUBX00",
        "GGA",
        "GNS",
        "RMC",
        "GLL",
    ):
        if name not in sources:
            continue
        epochs = np.flatnonzero(open_ & sources[name].has)
        if len(epochs) == 0:
            continue
        position = _position(sources[name], epochs)
        good = np.abs(position[:, 0]) <= np.pi / 2
        good &= np.abs(position[:, 1]) <= np.pi
        epochs, position = epochs[good], position[good]
        lat[epochs], lon[epochs], height[epochs], sep[epochs] = position[:, :4].T
        sd_pos[epochs] = position[:, 4:]
        open_[epochs] = False
        if name in ("RMC", "GLL"):
            flat = epochs[np.isin(fix_type[epochs], (FixType.THREE_D, FixType.DGNSS))]
            fix_type[flat] = FixType.TWO_D
        if name in ("PUBX00", "GGA", "GNS", "RMC", "GLL") and "GST" in sources:
            _error_statistics(sources["GST"], epochs, sd_pos)
    fix_type[open_] = FixType.NONE
    valid = fix_type != FixType.NONE
    velocity, sd_vel = _velocities(sources, valid, lat, lon)
    _covariances(sources, valid, sd_pos, sd_vel)
    return Fixes(
        gps_s=joined.gps_s,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=velocity,
        sd_pos_ned=sd_pos,
        sd_vel_ned=sd_vel,
        fix_type=fix_type,
        n_sats=_first_known(
            sources,
            n,
            (
                ("NAV-PVT", "numSV"),
                ("NAV-SOL", "numSV"),
                ("PUBX00", "numSVs"),
                ("GGA", "numSV"),
                ("GNS", "numSV"),
            ),
            -1.0,
        ).astype(np.int64),
        hdop=_first_known(
            sources,
            n,
            (
                ("NAV-DOP", "hDOP"),
                ("PUBX00", "HDOP"),
                ("GGA", "HDOP"),
                ("GNS", "HDOP"),
                ("GSA", "HDOP"),
            ),
            np.nan,
        ),
        geoid_sep_m=sep,
        offset=joined.offset,
        arrival_ns=np.full(n, NO_TIME, np.int64),
    )


def _first_known(
    sources: dict[str, _Rows], n: int, fields: tuple[tuple[str, str], ...], missing: float
) -> FloatArray:
    """The first of the fields that an epoch has [n]."""
    out = np.full(n, np.nan)
    for name, field in fields:
        if name in sources:
            epochs = np.flatnonzero(np.isnan(out) & sources[name].has)
            out[epochs] = sources[name].value(field, epochs)
    return np.where(np.isnan(out), missing, out)


def _ubx_fix(kind: IntArray, ok: BoolArray, differential: BoolArray) -> IntArray:
    """FixType of u-blox's fix number: 1 dead reckoning, 2 2D, 3 3D, 4 both; 0 and 5 none."""
    table = np.array([FixType.NONE, 1, 2, 3, 3, FixType.NONE], np.int64)
    fix = table[np.minimum(kind, 5)]
    fix[(fix == FixType.THREE_D) & differential] = FixType.DGNSS
    fix[~ok] = FixType.NONE
    return fix


def _fix_types(sources: dict[str, _Rows], n: int) -> IntArray:
    """What kind of fix each epoch is [n], by the message that knows best."""
    fix = np.full(n, FixType.NONE, np.int64)
    open_ = np.ones(n, bool)
    for name in (
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
    ):
        if name in sources:
            epochs = np.flatnonzero(open_ & sources[name].has)
            fix[epochs] = _fix_of(sources[name], epochs)
            open_[epochs] = False
    nmea_says = np.zeros(n, bool)
    for name in ("GGA", "GNS", "PUBX00", "RMC", "GLL"):
        if name in sources:
            nmea_says |= sources[name].has
    for name in ("NAV-PVT", "NAV-SOL", "NAV-STATUS"):
        if name in sources:
            nmea_says &= ~sources[name].has
    if "RMC" in sources:
        # a receiver may still give coordinates in GGA while it warns in RMC
        epochs = np.flatnonzero(nmea_says & sources["RMC"].has)
        warned = sources["RMC"].bits("status", epochs) == ord("V")
        fix[epochs[warned]] = FixType.NONE
    if "GSA" in sources:
        epochs = np.flatnonzero(nmea_says & sources["GSA"].has)
        flat = sources["GSA"].value("navMode", epochs) == 2
        flat &= np.isin(fix[epochs], (FixType.THREE_D, FixType.DGNSS))
        fix[epochs[flat]] = FixType.TWO_D
    return fix


def _fix_of(source: _Rows, epochs: IntArray) -> IntArray:
    if source.name == "NAV-PVT":
        flags = source.bits("flags", epochs)
        ok = (flags & 1 != 0) & (source.bits("flags3", epochs) & 1 == 0)
        fix = _ubx_fix(source.bits("fixType", epochs), ok, flags & 2 != 0)
        spatial = np.isin(fix, (FixType.THREE_D, FixType.DGNSS))
        carrier = flags >> 6
        fix[spatial & (carrier == 1)] = FixType.FLOAT
        fix[spatial & (carrier == 2)] = FixType.FIXED
        return fix
    if source.name in ("NAV-SOL", "NAV-STATUS"):
        flags = source.bits("flags", epochs)
        return _ubx_fix(source.bits("gpsFix", epochs), flags & 1 != 0, flags & 2 != 0)
    if source.name == "GGA":
        quality = np.nan_to_num(source.value("quality", epochs), nan=0.0).astype(np.int64)
        return _GGA_FIX[np.clip(quality, 0, 9)]
    if source.name == "PUBX00":
        status = source.value("navStat", epochs)
        fix = np.full(len(epochs), FixType.NONE, np.int64)
        for text, kind in _PUBX_FIX.items():
            fix[status == pack_text(text)] = kind
        # the combined and the time-only solution are written in other letters by some firmware
        return fix
    if source.name == "GNS":
        mode = source.bits("posMode", epochs)
        fix = np.full(len(epochs), FixType.NONE, np.int64)
        for letter, kind in sorted(_MODE_FIX.items(), key=lambda item: item[1]):
            for place in range(6):
                fix[(mode >> (8 * place)) & 255 == ord(letter)] = kind
        return fix
    if source.name in ("RMC", "GLL"):
        fix = np.full(len(epochs), FixType.THREE_D, np.int64)
        mode = source.bits("posMode", epochs)
        for letter, kind in _MODE_FIX.items():
            fix[mode == ord(letter)] = kind
        fix[source.bits("status", epochs) != ord("A")] = FixType.NONE
        return fix
    # a position that says nothing of its validity: u-blox reports a huge accuracy without a fix
    ok = source.value("hAcc", epochs) < 1e5
    if source.name == "NAV-HPPOSLLH":
        ok &= source.bits("flags", epochs) & 1 == 0
    return np.where(ok, FixType.THREE_D, FixType.NONE).astype(np.int64)


def _position(source: _Rows, epochs: IntArray) -> FloatArray:
    """Latitude, longitude (rad), ellipsoidal height, geoid separation, sd n, e, d [k, 7]."""
    out = np.full((len(epochs), 7), np.nan)

    def get(field: str) -> FloatArray:
        return source.value(field, epochs)

    if source.name == "NAV-SOL":
        import pymap3d

        lat, lon, height = pymap3d.ecef2geodetic(
            get("ecefX"), get("ecefY"), get("ecefZ"), deg=False
        )
        out[:, 0], out[:, 1], out[:, 2] = lat, lon, height
        out[:, 4:] = (get("pAcc") / np.sqrt(3.0))[:, None]
        return out
    degrees = np.stack([get("lat"), get("lon")], axis=1)
    if source.name == "NAV-HPPOSLLH":
        degrees += np.stack([get("latHp"), get("lonHp")], axis=1)
    out[:, :2] = np.radians(degrees)
    if source.name.startswith("NAV-"):
        height, msl = get("height"), get("hMSL")
        if source.name == "NAV-HPPOSLLH":
            height = height + get("heightHp")
            msl = msl + get("hMSLHp")
            out[get("flags").astype(np.int64) & 1 != 0, :2] = np.nan
        out[:, 2], out[:, 3] = height, height - msl
        out[:, 4:6] = (get("hAcc") / np.sqrt(2.0))[:, None]
        out[:, 6] = get("vAcc")
    elif source.name == "PUBX00":
        out[:, 2] = get("altRef")
        out[:, 4:6] = (get("hAcc") / np.sqrt(2.0))[:, None]
        out[:, 6] = get("vAcc")
    elif source.name in ("GGA", "GNS"):
        sep = get("sep")
        out[:, 2], out[:, 3] = get("alt") + _nearest_known(sep), sep
    return out


def _nearest_known(separation: FloatArray) -> FloatArray:
    """The separation, where missing that of a neighbour; 0 when the log has none at all."""
    known = np.flatnonzero(np.isfinite(separation))
    if len(known) == 0:
        return np.zeros_like(separation)
    before = np.searchsorted(known, np.arange(len(separation)), "right") - 1
    return np.asarray(separation[known[np.maximum(before, 0)]], np.float64)


def _error_statistics(gst: _Rows, epochs: IntArray, sd_pos: FloatArray) -> None:
    epochs = epochs[gst.has[epochs]]
    sd = np.stack([gst.value(f, epochs) for f in ("stdLat", "stdLong", "stdAlt")], axis=1)
    sd_pos[epochs] = np.where(np.isfinite(sd), sd, sd_pos[epochs])


def _velocities(
    sources: dict[str, _Rows], valid: BoolArray, lat: FloatArray, lon: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Velocity NED and its sd [n, 3]."""
    n = len(valid)
    velocity, sd = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    open_ = valid.copy()
    for name in ("NAV-PVT", "NAV-VELNED", "NAV-SOL", "PUBX00", "RMC", "VTG"):
        if name not in sources:
            continue
        source = sources[name]
        epochs = np.flatnonzero(open_ & source.has)
        if len(epochs) == 0:
            continue
        if name in ("NAV-PVT", "NAV-VELNED"):
            velocity[epochs] = np.stack(
                [source.value(f, epochs) for f in ("velN", "velE", "velD")], axis=1
            )
            sd[epochs] = (source.value("sAcc", epochs) / np.sqrt(3.0))[:, None]
        elif name == "NAV-SOL":
            ecef = [source.value(f, epochs) for f in ("ecefVX", "ecefVY", "ecefVZ")]
            velocity[epochs] = _ecef_to_ned(ecef, lat[epochs], lon[epochs])
            sd[epochs] = (source.value("sAcc", epochs) / np.sqrt(3.0))[:, None]
        else:
            velocity[epochs] = _from_course(source, epochs)
        open_[epochs] = ~np.isfinite(velocity[epochs, 0])
    return velocity, sd


def _from_course(source: _Rows, epochs: IntArray) -> FloatArray:
    """Velocity NED [k, 3] of a sentence with speed and course over ground."""
    speed_field, course_field, unit = {
        "RMC": ("spd", "cog", KNOT),
        "VTG": ("sogk", "cogt", 1.0 / 3.6),
        "PUBX00": ("SOG", "COG", 1.0 / 3.6),
    }[source.name]
    speed = source.value(speed_field, epochs) * unit
    if source.name == "VTG":
        knots = source.value("sogn", epochs) * KNOT
        speed = np.where(np.isfinite(knots), knots, speed)
    course = np.radians(source.value(course_field, epochs))
    course = np.where(np.isnan(course) & (speed < STANDSTILL_SPEED), 0.0, course)
    down = np.full(len(epochs), np.nan)
    if source.name == "PUBX00":
        down = source.value("vVel", epochs)
    return np.stack([speed * np.cos(course), speed * np.sin(course), down], axis=1)


def _ecef_to_ned(ecef: list[FloatArray], lat: FloatArray, lon: FloatArray) -> FloatArray:
    x, y, z = ecef
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    outward = cos_lon * x + sin_lon * y
    return np.stack(
        [
            -sin_lat * outward + cos_lat * z,
            -sin_lon * x + cos_lon * y,
            -cos_lat * outward - sin_lat * z,
        ],
        axis=1,
    )


def _covariances(
    sources: dict[str, _Rows], valid: BoolArray, sd_pos: FloatArray, sd_vel: FloatArray
) -> None:
    if "NAV-COV" not in sources:
        return
    cov = sources["NAV-COV"]
    for kind, flag, sd in (("pos", "posCovValid", sd_pos), ("vel", "velCovValid", sd_vel)):
        epochs = np.flatnonzero(valid & cov.has)
        epochs = epochs[cov.bits(flag, epochs) & 1 != 0]
        variance = np.stack(
            [cov.value(f"{kind}Cov{axis}", epochs) for axis in ("NN", "EE", "DD")], axis=1
        )
        good = np.isfinite(variance) & (variance > 0.0)
        sd[epochs] = np.where(good, np.sqrt(np.where(good, variance, 1.0)), sd[epochs])
