"""The strapdown step on the rotating ellipsoid, as numba kernels.

Attitude as a quaternion body to NED, velocity NED, position latitude, longitude, height.
Readings are taken as linear between samples; coning and sculling are exact for that.
Book: Savage, Strapdown Analytics, chapter 7; Groves, chapter 5.
"""

from __future__ import annotations

import math

from numba import njit

from automap import earth
from automap.records import FloatArray

radii = njit(cache=True)(earth.radii)
gravity = njit(cache=True)(earth.gravity)
EARTH_RATE = earth.RATE
GRAVITY_GRADIENT = 3.086e-6
"""Decrease of gravity per metre of height, 1/s^2."""

# a nominal state row: latitude, longitude, height, velocity NED, quaternion
N_NOMINAL = 10
# what changes slowly with place, refreshed at every node: see ``earth_terms``
N_EARTH = 9


@njit(cache=True)
def earth_terms(pos: FloatArray, earth_on: bool, out: FloatArray) -> None:
    """Write the terms of a place [9]: radii m, gravity, height m, sine and cosine of the
    latitude, Earth rate north and down, latitude.

    ``pos`` [3] latitude, longitude rad, height m. Good for some hundred metres around it.
    """
    lat, height = pos[0], pos[2]
    rm, rn = radii(lat)
    rate = EARTH_RATE if earth_on else 0.0
    s, c = math.sin(lat), math.cos(lat)
    out[0] = rm
    out[1] = rn
    out[2] = gravity(lat, height)
    out[3] = height
    out[4] = s
    out[5] = c
    out[6] = rate * c
    out[7] = -rate * s
    out[8] = lat


@njit(cache=True)
def quat_to_dcm(q: FloatArray, c: FloatArray) -> None:
    """Write the matrix [3, 3] of the unit quaternion ``q`` [4] into ``c``."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    c[0, 0] = w * w + x * x - y * y - z * z
    c[0, 1] = 2 * (x * y - w * z)
    c[0, 2] = 2 * (x * z + w * y)
    c[1, 0] = 2 * (x * y + w * z)
    c[1, 1] = w * w - x * x + y * y - z * z
    c[1, 2] = 2 * (y * z - w * x)
    c[2, 0] = 2 * (x * z - w * y)
    c[2, 1] = 2 * (y * z + w * x)
    c[2, 2] = w * w - x * x - y * y + z * z


@njit(cache=True)
def _half_turn(n2: float) -> tuple[float, float]:
    """sin(n/2)/n and cos(n/2) of a squared angle."""
    if n2 < 1e-4:
        return 0.5 - n2 / 48.0 + n2 * n2 / 3840.0, 1.0 - n2 / 8.0 + n2 * n2 / 384.0
    n = math.sqrt(n2)
    return math.sin(0.5 * n) / n, math.cos(0.5 * n)


@njit(cache=True)
def rotate_left(q: FloatArray, x: float, y: float, z: float) -> None:
    """q := exp((x, y, z)) q: turn the navigation side by a rotation vector in rad."""
    s, c = _half_turn(x * x + y * y + z * z)
    a, b, d = s * x, s * y, s * z
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    q[0] = c * w0 - a * x0 - b * y0 - d * z0
    q[1] = c * x0 + a * w0 + b * z0 - d * y0
    q[2] = c * y0 - a * z0 + b * w0 + d * x0
    q[3] = c * z0 + a * y0 - b * x0 + d * w0


@njit(cache=True)
def rotate_right(q: FloatArray, x: float, y: float, z: float) -> None:
    """q := q exp((x, y, z)): turn the body by a rotation vector in rad; renormalises."""
    s, c = _half_turn(x * x + y * y + z * z)
    a, b, d = s * x, s * y, s * z
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    w1 = c * w0 - a * x0 - b * y0 - d * z0
    x1 = c * x0 + a * w0 + d * y0 - b * z0
    y1 = c * y0 + b * w0 + a * z0 - d * x0
    z1 = c * z0 + d * w0 + b * x0 - a * y0
    r = 1.0 / math.sqrt(w1 * w1 + x1 * x1 + y1 * y1 + z1 * z1)
    q[0], q[1], q[2], q[3] = w1 * r, x1 * r, y1 * r, z1 * r


@njit(cache=True)
def strapdown_step(
    pos: FloatArray,
    vel: FloatArray,
    q: FloatArray,
    c: FloatArray,
    ra: FloatArray,
    rb: FloatArray,
    dt: float,
    e: FloatArray,
    dvn: FloatArray,
) -> None:
    """Advance position [3], velocity [3] and attitude [4] in place over ``dt`` seconds.

    ``c`` [3, 3] is the attitude matrix at the start and is refreshed for the end; ``ra``,
    ``rb`` [6] are corrected angular rates and specific forces at start and end; ``e`` [9] the
    terms of the place; ``dvn`` [3] receives the specific-force velocity increment in NED.
    """
    wx, wy, wz = 0.5 * (ra[0] + rb[0]) * dt, 0.5 * (ra[1] + rb[1]) * dt, 0.5 * (ra[2] + rb[2]) * dt
    fx, fy, fz = 0.5 * (ra[3] + rb[3]) * dt, 0.5 * (ra[4] + rb[4]) * dt, 0.5 * (ra[5] + rb[5]) * dt
    k = dt * dt / 12.0
    # rotation of the velocity increment, and sculling
    bx = fx + 0.5 * (wy * fz - wz * fy)
    by = fy + 0.5 * (wz * fx - wx * fz)
    bz = fz + 0.5 * (wx * fy - wy * fx)
    bx += k * (ra[1] * rb[5] - ra[2] * rb[4] + ra[4] * rb[2] - ra[5] * rb[1])
    by += k * (ra[2] * rb[3] - ra[0] * rb[5] + ra[5] * rb[0] - ra[3] * rb[2])
    bz += k * (ra[0] * rb[4] - ra[1] * rb[3] + ra[3] * rb[1] - ra[4] * rb[0])
    # coning
    wx += k * (ra[1] * rb[2] - ra[2] * rb[1])
    wy += k * (ra[2] * rb[0] - ra[0] * rb[2])
    wz += k * (ra[0] * rb[1] - ra[1] * rb[0])

    rise = pos[2] - e[3]
    rm, rn = e[0] + pos[2], e[1] + pos[2]
    g = e[2] - GRAVITY_GRADIENT * rise
    ien, ied = e[6], e[7]
    enn = vel[1] / rn
    ene = -vel[0] / rm
    end = -vel[1] * e[4] / (e[5] * rn)
    zn, ze, zd = (ien + enn) * dt, ene * dt, (ied + end) * dt

    an = c[0, 0] * bx + c[0, 1] * by + c[0, 2] * bz
    ae = c[1, 0] * bx + c[1, 1] * by + c[1, 2] * bz
    ad = c[2, 0] * bx + c[2, 1] * by + c[2, 2] * bz
    # the frame turns by zeta during the step: half of it on average
    dvn[0] = an - 0.5 * (ze * ad - zd * ae)
    dvn[1] = ae - 0.5 * (zd * an - zn * ad)
    dvn[2] = ad - 0.5 * (zn * ae - ze * an)

    v0, v1, v2 = vel[0], vel[1], vel[2]
    vn = v0 + 0.5 * dvn[0]
    ve = v1 + 0.5 * dvn[1]
    vd = v2 + 0.5 * (dvn[2] + g * dt)
    cn, ce, cd = 2 * ien + enn, ene, 2 * ied + end
    vel[0] += dvn[0] - (ce * vd - cd * ve) * dt
    vel[1] += dvn[1] - (cd * vn - cn * vd) * dt
    vel[2] += dvn[2] + g * dt - (cn * ve - ce * vn) * dt

    dn = 0.5 * (v0 + vel[0]) * dt
    pos[2] -= 0.5 * (v2 + vel[2]) * dt
    pos[0] += dn / rm
    # cosine of the latitude in the middle of the step, from the place's own
    north = (pos[0] - e[8]) - 0.5 * dn / rm
    cos_lat = e[5] - e[4] * north
    pos[1] += 0.5 * (v1 + vel[1]) * dt / (rn * cos_lat)

    rotate_right(q, wx, wy, wz)
    rotate_left(q, -zn, -ze, -zd)
    quat_to_dcm(q, c)
