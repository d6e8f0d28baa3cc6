"""Fixes from joined epochs: for every quantity the best message that has it.

UBX goes before NMEA, newer messages before older ones. Accuracy figures become one sigma per
axis: ``hAcc`` is the radius of both horizontal axes together (divided by sqrt 2), ``sAcc`` of
SOL, VELNED and PVT and ``pAcc`` of SOL are of three axes together (divided by sqrt 3);
NAV-COV and GST give each axis and go before the others.
"""

from __future__ import annotations

import numpy as np

from automap.io.epoch_fix_type import fix_types
from automap.io.epoch_join import Joined
from automap.io.epoch_position import positions
from automap.io.epoch_source import Source, among, select
from automap.io.epoch_velocity import velocities
from automap.io.nmea import NmeaTable
from automap.io.ubx import Table
from automap.records import NO_TIME, BoolArray, Fixes, FixType, FloatArray

_SATELLITES = (
    ("NAV-PVT", "numSV"),
    ("NAV-SOL", "numSV"),
    ("PUBX00", "numSVs"),
    ("GGA", "numSV"),
    ("GNS", "numSV"),
)
_HDOP = (
    ("NAV-DOP", "hDOP"),
    ("PUBX00", "HDOP"),
    ("GGA", "HDOP"),
    ("GNS", "HDOP"),
    ("GSA", "HDOP"),
)

_SAME_PLACE_RAD = 3e-8
"""Within 0.2 m: four decimals of a minute, which is what the poorest sentences have."""


def build_fixes(joined: Joined, ubx: dict[str, Table], nmea: dict[str, NmeaTable]) -> Fixes:
    """Fixes of joined epochs, one row each.

    An epoch without a valid position stays as a row of type NONE whose values are NaN.
    """
    n = len(joined.gps_s)
    sources = {name: Source(name, joined, ubx, nmea) for name in joined.rows}
    sources = {name: source for name, source in sources.items() if source.has.any()}
    fix = fix_types(sources, n)
    lat, lon, height, separation, sd_pos = positions(sources, fix)
    valid = fix != FixType.NONE
    velocity, sd_vel = velocities(sources, valid, lat, lon)
    _covariances(sources, valid, sd_pos, sd_vel)
    for sd in (sd_pos, sd_vel):
        # a garbled figure with a sign, or a zero of a receiver that does not know
        sd[~(sd > 0.0)] = np.nan
    n_sats = _first_known(sources, n, _SATELLITES)
    # NaN compares false; no sky holds a thousand
    n_sats[~((n_sats >= 0.0) & (n_sats < 1000.0))] = -1.0
    return Fixes(
        gps_s=joined.gps_s,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=velocity,
        sd_pos_ned=sd_pos,
        sd_vel_ned=sd_vel,
        fix_type=fix.astype(np.int64),
        n_sats=n_sats.astype(np.int64),
        hdop=_first_known(sources, n, _HDOP),
        geoid_sep_m=separation,
        offset=joined.offset,
        arrival_ns=np.full(n, NO_TIME, np.int64),
    )


def take_once(fixes: Fixes) -> tuple[Fixes, int]:
    """Fixes without those [k] that tell time and place of the one before them again, as the
    talkers of one receiver do, and how many these were; what they alone know goes into it."""
    place = np.column_stack([fixes.lat_rad, fixes.lon_rad])
    again = np.diff(fixes.gps_s) == 0.0
    again &= (np.abs(np.diff(place, axis=0)) < _SAME_PLACE_RAD).all(axis=1)
    if not again.any():
        return fixes, 0
    first = np.flatnonzero(np.concatenate([[True], ~again]))
    end = np.append(first[1:], len(fixes))
    columns = {name: values[first] for name, values in vars(fixes).items()}
    for name in ("height_m", "geoid_sep_m", "hdop", "vel_ned", "sd_pos_ned", "sd_vel_ned"):
        values = vars(fixes)[name]
        known = np.isfinite(values if values.ndim == 1 else values[:, 0])
        next_known = np.where(known, np.arange(len(fixes)), len(fixes))
        told = np.minimum.accumulate(next_known[::-1])[::-1][first]
        columns[name][told < end] = values[told[told < end]]
    return Fixes(**columns), int(np.count_nonzero(again))


def _first_known(
    sources: dict[str, Source], n: int, fields: tuple[tuple[str, str], ...]
) -> FloatArray:
    """The first of the fields that an epoch has [n], NaN where it has none."""
    out = np.full(n, np.nan)
    open_ = np.ones(n, bool)
    for name, field in fields:
        if name not in sources:
            continue
        mask = open_ & sources[name].has
        if mask.any():
            epochs = select(mask)
            out[epochs] = sources[name].value(field, epochs)
            open_ = np.isnan(out)
    return out


def _covariances(
    sources: dict[str, Source], valid: BoolArray, sd_pos: FloatArray, sd_vel: FloatArray
) -> None:
    """Put the variances of NAV-COV into the sd [n, 3] of the ``valid`` epochs [n]."""
    if "NAV-COV" not in sources:
        return
    cov = sources["NAV-COV"]
    epochs = select(valid & cov.has)
    for kind, flag, sd in (("pos", "posCovValid", sd_pos), ("vel", "velCovValid", sd_vel)):
        told = among(epochs, cov.counts(flag, epochs) & 1 != 0)
        variance = np.stack(
            [cov.value(f"{kind}Cov{axis}", told) for axis in ("NN", "EE", "DD")], axis=1
        )
        good = np.isfinite(variance) & (variance > 0.0)
        sd[told] = np.where(good, np.sqrt(np.where(good, variance, 1.0)), sd[told])
