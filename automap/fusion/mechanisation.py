"""The strapdown step on the rotating ellipsoid, as a numba kernel.

Attitude as a quaternion body to NED, velocity NED, position latitude, longitude, height.
Readings are taken as linear between samples; coning and sculling are exact for that.
Book: Savage, Strapdown Analytics, chapter 7; Groves, chapter 5.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from automap import earth

radii = njit(cache=True)(earth.radii)
gravity = njit(cache=True)(earth.gravity)
EARTH_RATE = earth.RATE

# position of each quantity in a state row
LAT, LON, HGT, VN, VE, VD, Q0, Q1, Q2, Q3 = range(10)
N_NOMINAL = 10


@njit(cache=True)
def quat_to_dcm(q, c):
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
def rotate_left(q, x, y, z):
    """q := exp((x, y, z)) q: turn the navigation side by a rotation vector in rad."""
    n2 = x * x + y * y + z * z
    s = 0.5 - n2 / 48.0
    c = 1.0 - n2 / 8.0
    if n2 > 1e-4:
        n = math.sqrt(n2)
        s = math.sin(0.5 * n) / n
        c = math.cos(0.5 * n)
    a, b, d = s * x, s * y, s * z
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    q[0] = c * w0 - a * x0 - b * y0 - d * z0
    q[1] = c * x0 + a * w0 + b * z0 - d * y0
    q[2] = c * y0 - a * z0 + b * w0 + d * x0
    q[3] = c * z0 + a * y0 - b * x0 + d * w0


@njit(cache=True)
def rotate_right(q, x, y, z):
    """q := q exp((x, y, z)): turn the body by a rotation vector in rad; renormalises."""
    n2 = x * x + y * y + z * z
    s = 0.5 - n2 / 48.0
    c = 1.0 - n2 / 8.0
    if n2 > 1e-4:
        n = math.sqrt(n2)
        s = math.sin(0.5 * n) / n
        c = math.cos(0.5 * n)
    a, b, d = s * x, s * y, s * z
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    w1 = c * w0 - a * x0 - b * y0 - d * z0
    x1 = c * x0 + a * w0 + d * y0 - b * z0
    y1 = c * y0 + b * w0 + a * z0 - d * x0
    z1 = c * z0 + d * w0 + b * x0 - a * y0
    r = 1.0 / math.sqrt(w1 * w1 + x1 * x1 + y1 * y1 + z1 * z1)
    q[0], q[1], q[2], q[3] = w1 * r, x1 * r, y1 * r, z1 * r


@njit(cache=True)
def strapdown_step(pos, vel, q, c, ra, rb, dt, earth_on, dvn):
    """Advance position [3], velocity [3] and attitude [4] in place over ``dt`` seconds.

    ``c`` [3, 3] is the attitude matrix at the start and is refreshed for the end; ``ra``,
    ``rb`` [6] are corrected angular rates and specific forces at start and end; ``dvn`` [3]
    receives the specific-force velocity increment in NED.
    """
    wx, wy, wz = 0.5 * (ra[0] + rb[0]) * dt, 0.5 * (ra[1] + rb[1]) * dt, 0.5 * (ra[2] + rb[2]) * dt
    fx, fy, fz = 0.5 * (ra[3] + rb[3]) * dt, 0.5 * (ra[4] + rb[4]) * dt, 0.5 * (ra[5] + rb[5]) * dt
    k = dt * dt / 12.0
    # sculling and rotation of the velocity increment
    sx = 0.5 * (wy * fz - wz * fy) + k * (
        ra[1] * rb[5] - ra[2] * rb[4] + ra[4] * rb[2] - ra[5] * rb[1]
    )
    sy = 0.5 * (wz * fx - wx * fz) + k * (
        ra[2] * rb[3] - ra[0] * rb[5] + ra[5] * rb[0] - ra[3] * rb[2]
    )
    sz = 0.5 * (wx * fy - wy * fx) + k * (
        ra[0] * rb[4] - ra[1] * rb[3] + ra[3] * rb[1] - ra[4] * rb[0]
    )
    bx, by, bz = fx + sx, fy + sy, fz + sz
    # coning
    wx += k * (ra[1] * rb[2] - ra[2] * rb[1])
    wy += k * (ra[2] * rb[0] - ra[0] * rb[2])
    wz += k * (ra[0] * rb[1] - ra[1] * rb[0])

    lat, h = pos[0], pos[2]
    rm, rn = radii(lat)
    rate = EARTH_RATE if earth_on else 0.0
    ien, ied = rate * math.cos(lat), -rate * math.sin(lat)
    enn = vel[1] / (rn + h)
    ene = -vel[0] / (rm + h)
    end = -vel[1] * math.tan(lat) / (rn + h)
    zn, ze, zd = (ien + enn) * dt, ene * dt, (ied + end) * dt

    an = c[0, 0] * bx + c[0, 1] * by + c[0, 2] * bz
    ae = c[1, 0] * bx + c[1, 1] * by + c[1, 2] * bz
    ad = c[2, 0] * bx + c[2, 1] * by + c[2, 2] * bz
    # the frame turns by zeta during the step: half of it on average
    dvn[0] = an - 0.5 * (ze * ad - zd * ae)
    dvn[1] = ae - 0.5 * (zd * an - zn * ad)
    dvn[2] = ad - 0.5 * (zn * ae - ze * an)

    g = gravity(lat, h)
    vn = vel[0] + 0.5 * dvn[0]
    ve = vel[1] + 0.5 * dvn[1]
    vd = vel[2] + 0.5 * (dvn[2] + g * dt)
    cn, ce, cd = 2 * ien + enn, ene, 2 * ied + end
    v0, v1, v2 = vel[0], vel[1], vel[2]
    vel[0] += dvn[0] - (ce * vd - cd * ve) * dt
    vel[1] += dvn[1] - (cd * vn - cn * vd) * dt
    vel[2] += dvn[2] + g * dt - (cn * ve - ce * vn) * dt

    pos[2] -= 0.5 * (v2 + vel[2]) * dt
    hm = 0.5 * (h + pos[2])
    pos[0] += 0.5 * (v0 + vel[0]) * dt / (rm + hm)
    latm = 0.5 * (lat + pos[0])
    pos[1] += 0.5 * (v1 + vel[1]) * dt / ((rn + hm) * math.cos(latm))

    rotate_right(q, wx, wy, wz)
    rotate_left(q, -zn, -ze, -zd)
    quat_to_dcm(q, c)


@njit(cache=True)
def correct_reading(raw, extra, terms, theta, out):
    """Corrected rates and forces ``out`` [6] of a raw reading [6].

    reading = true + sum theta phi(true): phi is taken at a first estimate of the truth, which
    leaves an error of third order in theta. ``terms`` [m, 3] sensor, axis, basis.
    """
    for i in range(6):
        out[i] = raw[i]
    first = np.empty(6)
    for sweep in range(2):
        for i in range(6):
            first[i] = out[i]
            out[i] = raw[i]
        for j in range(terms.shape[0]):
            b = terms[j, 2]
            phi = 1.0 if b == 0 else (first[b - 1] if b < 7 else extra[b - 7])
            row = terms[j, 1] + (3 if terms[j, 0] == 1 else 0)
            out[row] -= theta[j] * phi
