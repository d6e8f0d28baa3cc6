"""Positions as an RTKLIB solution, the form that carries every sigma.

Reference: RTKLIB 2.4.2 manual, appendix B.1, with the velocity columns of RTKLIB demo5.
"""

from __future__ import annotations

import numpy as np

from automap.records import FixType, FloatArray, IntArray
from automap.timebase import gps_to_week

_HEAD = (
    "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,4:dgps,5:single,7:dr)\n"
    "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)"
    "  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio    vn(m/s)    ve(m/s)    vu(m/s)"
    "      sdvn      sdve      sdvu\n"
)
_QUALITY = {
    FixType.NONE: 0,
    FixType.DEAD_RECKONING: 7,
    FixType.TWO_D: 5,
    FixType.THREE_D: 5,
    FixType.DGNSS: 4,
    FixType.FLOAT: 2,
    FixType.FIXED: 1,
}


def pos_log(
    gps_s: FloatArray,
    lat_deg: FloatArray,
    lon_deg: FloatArray,
    height_m: FloatArray,
    fix_type: IntArray,
    sd_pos_ned: FloatArray | None = None,
    vel_ned: FloatArray | None = None,
    sd_vel_ned: FloatArray | None = None,
) -> tuple[bytes, IntArray]:
    """The positions [n] as a .pos file, and the byte [n] where each row starts.

    Heights above the ellipsoid; sigmas and velocity [n, 3] in m and m/s, NaN where unknown.
    """
    n = len(gps_s)
    nothing = np.full((n, 3), np.nan)
    sd = nothing if sd_pos_ned is None else sd_pos_ned
    velocity = nothing if vel_ned is None else vel_ned
    sd_velocity = nothing if sd_vel_ned is None else sd_vel_ned
    week, tow = gps_to_week(gps_s)
    parts = [_HEAD.encode("ascii")]
    length = len(parts[0])
    offsets = np.empty(n, np.int64)
    for i in range(n):
        quality = _QUALITY.get(FixType(int(fix_type[i])), 5)
        v, sv = velocity[i], sd_velocity[i]
        row = (
            f"{week[i]:4d} {tow[i]:13.6f} {lat_deg[i]:14.10f} {lon_deg[i]:15.10f} "
            f"{_value(height_m[i], 4)} {quality} nan "
            f"{_sd(sd[i, 0])} {_sd(sd[i, 1])} {_sd(sd[i, 2])} 0 0 0 0 0 "
            f"{_value(v[0], 4)} {_value(v[1], 4)} {_value(-v[2], 4)} "
            f"{_sd(sv[0])} {_sd(sv[1])} {_sd(sv[2])}\n"
        ).encode("ascii")
        offsets[i] = length
        length += len(row)
        parts.append(row)
    return b"".join(parts), offsets


def _value(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "nan"


def _sd(value: float) -> str:
    # RTKLIB writes zero where it has no figure
    return f"{value:.4f}" if np.isfinite(value) and value > 0.0 else "0"
