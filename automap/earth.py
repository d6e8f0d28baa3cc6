"""WGS-84: constants, radii, gravity, local metres.

``radii`` and ``gravity`` take scalars or arrays and compile as they are, so the filter's
kernels use the same definition. Book: Groves, chapter 2.4; gravity by Somigliana with the
free-air terms of NIMA TR8350.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray

A = 6378137.0
"""Semi-major axis, m."""
F = 1.0 / 298.257223563
"""Flattening."""
E2 = F * (2.0 - F)
MEAN_RADIUS = 6.371e6
"""Of a sphere, m: for distances that need no more than half a percent."""
RATE = 7.292115e-5
"""Earth rotation, rad/s."""
STANDARD_GRAVITY = 9.80665
"""The "g" of data sheets and units, m/s^2; ``gravity`` is that of a place."""
GRAVITY_GRADIENT = 3.086e-6
"""Decrease of gravity per metre of height, 1/s^2."""
GM = 3.986004418e14
"""Gravitational constant of the Earth with its atmosphere, m^3/s^2."""
_B = A * (1.0 - F)
_GE, _K = 9.7803253359, 0.00193185265241
"""Normal gravity at the equator, m/s^2, and the constant of Somigliana's formula."""
_M = RATE**2 * A**2 * _B / GM


def radii(lat: Any) -> Any:
    """Meridian and transverse radius of curvature in m at a latitude in rad (Groves, 2nd ed.,
    section 2.4.2)."""
    w = 1.0 - E2 * np.sin(lat) ** 2
    root = np.sqrt(w)
    return A * (1.0 - E2) / (w * root), A / root


def gravity(lat: Any, height: Any) -> Any:
    """Local gravity in m/s^2, positive down, at latitude in rad and ellipsoidal height in m.

    Somigliana's formula on the ellipsoid, to second order in the height: NIMA TR8350.2, chapter 4.
    """
    s2 = np.sin(lat) ** 2
    g0 = _GE * (1.0 + _K * s2) / np.sqrt(1.0 - E2 * s2)
    factor = 1.0 - 2.0 / A * (1.0 + F * (1.0 - 2.0 * s2) + _M) * height
    return g0 * (factor + 3.0 * height * height / (A * A))


def metres_per_radian(
    lat_rad: npt.ArrayLike, height_m: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Metres north per radian of latitude and metres east per radian of longitude, [n] each."""
    lat = np.asarray(lat_rad, np.float64)
    h = np.asarray(height_m, np.float64)
    meridian, transverse = radii(lat)
    return np.asarray(meridian + h), np.asarray((transverse + h) * np.cos(lat))


def local_ned(
    lat_rad: npt.ArrayLike,
    lon_rad: npt.ArrayLike,
    height_m: npt.ArrayLike,
    ref: tuple[float, float, float],
) -> FloatArray:
    """Position [n, 3] in metres north, east, down of a reference (lat rad, lon rad, height m).

    The exact tangent-plane coordinates; valid across the date line.
    """
    from pymap3d import geodetic2ned

    n, e, d = geodetic2ned(
        np.asarray(lat_rad, np.float64),
        np.asarray(lon_rad, np.float64),
        np.asarray(height_m, np.float64),
        *ref,
        deg=False,
    )
    return np.stack([np.asarray(n), np.asarray(e), np.asarray(d)], axis=-1)


def from_local_ned(
    ned: npt.ArrayLike, ref: tuple[float, float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Latitude, longitude (rad) and height (m), [n] each, of tangent-plane positions [n, 3]."""
    from pymap3d import ned2geodetic

    p = np.asarray(ned, np.float64)
    lat, lon, h = ned2geodetic(p[..., 0], p[..., 1], p[..., 2], *ref, deg=False)
    # pymap3d drops the axis of a single row
    shape = p.shape[:-1]
    return tuple(np.asarray(v, dtype=np.float64).reshape(shape) for v in (lat, lon, h))  # type: ignore[return-value]


def ecef(lat_rad: npt.ArrayLike, lon_rad: npt.ArrayLike, height_m: npt.ArrayLike) -> FloatArray:
    """Earth-fixed coordinates [n, 3] in m of positions [n]."""
    from pymap3d import geodetic2ecef

    return np.stack(geodetic2ecef(lat_rad, lon_rad, height_m, deg=False), axis=-1)


def ecef_axes(lat_rad: npt.ArrayLike, lon_rad: npt.ArrayLike) -> FloatArray:
    """Matrices ``C_e_n`` [n, 3, 3], NED to Earth-fixed axes, at latitudes and longitudes [n]."""
    lat, lon = np.atleast_1d(lat_rad).astype(float), np.atleast_1d(lon_rad).astype(float)
    sa, ca, so, co = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    zero = np.zeros_like(lat)
    north = np.stack([-sa * co, -sa * so, ca], axis=-1)
    east = np.stack([-so, co, zero], axis=-1)
    down = np.stack([-ca * co, -ca * so, -sa], axis=-1)
    return np.stack([north, east, down], axis=-1)


def tangent_rotation(
    lat_rad: npt.ArrayLike, lon_rad: npt.ArrayLike, origin: tuple[float, float, float]
) -> FloatArray:
    """Rotations [n, 3, 3] from the NED axes at each point [n] to the NED axes at ``origin``
    (lat rad, lon rad, height m)."""
    return np.asarray(ecef_axes(origin[0], origin[1])[0].T @ ecef_axes(lat_rad, lon_rad))
