"""The strapdown step on the rotating ellipsoid, as numba kernels.

Attitude as a quaternion body to NED, velocity NED, position latitude, longitude, height.
Readings are taken as linear between samples; coning and sculling are exact for that.
Book: Savage, Strapdown Analytics, chapter 7; Groves, chapter 5.
"""

from __future__ import annotations

import math

from automap import earth
from automap.jit import kernel
from automap.records import FloatArray

radii = kernel(earth.radii)
gravity = kernel(earth.gravity)
EARTH_RATE, GRAVITY_GRADIENT = earth.RATE, earth.GRAVITY_GRADIENT

# what changes slowly with place, refreshed at every node: see ``earth_terms``
N_EARTH = 9


@kernel
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


@kernel
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


@kernel
def _half_turn(n2: float) -> tuple[float, float]:
    """sin(n/2)/n and cos(n/2) of a squared angle."""
    if n2 < 1e-4:
        return 0.5 - n2 / 48.0 + n2 * n2 / 3840.0, 1.0 - n2 / 8.0 + n2 * n2 / 384.0
    n = math.sqrt(n2)
    return math.sin(0.5 * n) / n, math.cos(0.5 * n)


@kernel
def rotate_left(q: FloatArray, x: float, y: float, z: float) -> None:
    """q := exp((x, y, z)) q: turn the navigation side by a rotation vector in rad."""
    s, c = _half_turn(x * x + y * y + z * z)
    a, b, d = s * x, s * y, s * z
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    q[0] = c * w0 - a * x0 - b * y0 - d * z0
    q[1] = c * x0 + a * w0 + b * z0 - d * y0
    q[2] = c * y0 - a * z0 + b * w0 + d * x0
    q[3] = c * z0 + a * y0 - b * x0 + d * w0


@kernel
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


@kernel
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
    terms of the place; ``dvn`` [3] receives the specific-force velocity increment in NED. Coning
    after J. E. Bortz (IEEE Transactions on Aerospace and Electronic Systems 7, 1971), sculling as
    its counterpart (Savage, chapter 7); Earth and transport rate: Groves, section 5.4.
    """
    # everything in locals: the compiler cannot know that the arrays do not overlap
    p0, p1, p2 = ra[0], ra[1], ra[2]
    f0, f1, f2 = ra[3], ra[4], ra[5]
    r0, r1, r2 = rb[0], rb[1], rb[2]
    g0, g1, g2 = rb[3], rb[4], rb[5]
    lat, lon, height = pos[0], pos[1], pos[2]
    v0, v1, v2 = vel[0], vel[1], vel[2]
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    half = 0.5 * dt
    wx, wy, wz = half * (p0 + r0), half * (p1 + r1), half * (p2 + r2)
    fx, fy, fz = half * (f0 + g0), half * (f1 + g1), half * (f2 + g2)
    k = dt * dt / 12.0
    # rotation of the velocity increment, and sculling
    bx = fx + 0.5 * (wy * fz - wz * fy) + k * (p1 * g2 - p2 * g1 + f1 * r2 - f2 * r1)
    by = fy + 0.5 * (wz * fx - wx * fz) + k * (p2 * g0 - p0 * g2 + f2 * r0 - f0 * r2)
    bz = fz + 0.5 * (wx * fy - wy * fx) + k * (p0 * g1 - p1 * g0 + f0 * r1 - f1 * r0)
    # coning
    wx += k * (p1 * r2 - p2 * r1)
    wy += k * (p2 * r0 - p0 * r2)
    wz += k * (p0 * r1 - p1 * r0)

    g = e[2] - GRAVITY_GRADIENT * (height - e[3])
    inv_rm, inv_rn = 1.0 / (e[0] + height), 1.0 / (e[1] + height)
    inv_cos = 1.0 / e[5]
    ien, ied = e[6], e[7]
    enn = v1 * inv_rn
    ene = -v0 * inv_rm
    end = -v1 * e[4] * inv_cos * inv_rn
    zn, ze, zd = (ien + enn) * dt, ene * dt, (ied + end) * dt

    an = c[0, 0] * bx + c[0, 1] * by + c[0, 2] * bz
    ae = c[1, 0] * bx + c[1, 1] * by + c[1, 2] * bz
    ad = c[2, 0] * bx + c[2, 1] * by + c[2, 2] * bz
    # the frame turns by zeta during the step: half of it on average
    dn = an - 0.5 * (ze * ad - zd * ae)
    de = ae - 0.5 * (zd * an - zn * ad)
    dd = ad - 0.5 * (zn * ae - ze * an)

    vn, ve, vd = v0 + 0.5 * dn, v1 + 0.5 * de, v2 + 0.5 * (dd + g * dt)
    cn, ce, cd = 2 * ien + enn, ene, 2 * ied + end
    u0 = v0 + dn - (ce * vd - cd * ve) * dt
    u1 = v1 + de - (cd * vn - cn * vd) * dt
    u2 = v2 + dd + g * dt - (cn * ve - ce * vn) * dt

    north = half * (v0 + u0) * inv_rm
    # one over the cosine of the latitude in the middle of the step, from the place's own
    off = (lat + 0.5 * north - e[8]) * e[4] * inv_cos
    pos[0] = lat + north
    pos[1] = lon + half * (v1 + u1) * inv_rn * inv_cos * (1.0 + off + off * off)
    pos[2] = height - half * (v2 + u2)
    vel[0], vel[1], vel[2] = u0, u1, u2
    dvn[0], dvn[1], dvn[2] = dn, de, dd

    # q := exp(-zeta) q exp(w)
    s, m = _half_turn(wx * wx + wy * wy + wz * wz)
    a, b, d = s * wx, s * wy, s * wz
    w1 = m * w0 - a * x0 - b * y0 - d * z0
    x1 = m * x0 + a * w0 + d * y0 - b * z0
    y1 = m * y0 + b * w0 + a * z0 - d * x0
    z1 = m * z0 + d * w0 + b * x0 - a * y0
    # the frame's turn over a step is below a millionth: its half angles need no sine
    a, b, d = -0.5 * zn, -0.5 * ze, -0.5 * zd
    w2 = w1 - a * x1 - b * y1 - d * z1
    x2 = x1 + a * w1 + b * z1 - d * y1
    y2 = y1 - a * z1 + b * w1 + d * x1
    z2 = z1 + a * y1 - b * x1 + d * w1
    # one Newton step keeps the norm, which is one to rounding
    r = 1.5 - 0.5 * (w2 * w2 + x2 * x2 + y2 * y2 + z2 * z2)
    w2, x2, y2, z2 = w2 * r, x2 * r, y2 * r, z2 * r
    q[0], q[1], q[2], q[3] = w2, x2, y2, z2
    ww, xx, yy, zz = w2 * w2, x2 * x2, y2 * y2, z2 * z2
    wx2, wy2, wz2 = 2 * w2 * x2, 2 * w2 * y2, 2 * w2 * z2
    xy2, xz2, yz2 = 2 * x2 * y2, 2 * x2 * z2, 2 * y2 * z2
    c[0, 0], c[0, 1], c[0, 2] = ww + xx - yy - zz, xy2 - wz2, xz2 + wy2
    c[1, 0], c[1, 1], c[1, 2] = xy2 + wz2, ww - xx + yy - zz, yz2 - wx2
    c[2, 0], c[2, 1], c[2, 2] = xz2 - wy2, yz2 + wx2, ww - xx - yy + zz
