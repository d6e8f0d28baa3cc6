"""The WGS-84 ellipsoid, its gravity and its rotation, in closed form.

Reference: NIMA TR8350.2, third edition, chapters 3 and 4.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
EARTH_RATE = 7.292115e-5
_GM = 3.986004418e14
_GAMMA_EQUATOR = 9.7803253359
_GAMMA_POLE = 9.8321849378


def meridian_radius(lat: Array) -> Array:
    """Radius of curvature [n], m, along the meridian at latitudes ``lat`` [n], rad."""
    w2 = 1.0 - ECCENTRICITY_2 * np.sin(lat) ** 2
    return np.asarray(SEMI_MAJOR_M * (1.0 - ECCENTRICITY_2) / (w2 * np.sqrt(w2)))


def normal_radius(lat: Array) -> Array:
    """Radius of curvature [n], m, across the meridian at latitudes ``lat`` [n], rad."""
    return np.asarray(SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_2 * np.sin(lat) ** 2))


def normal_gravity(lat: Array, height: Array) -> Array:
    """Magnitude [n], m/s^2, of gravity at ``lat`` [n], rad, and ellipsoidal ``height`` [n], m.

    Somigliana's formula on the ellipsoid and its second-order continuation upwards
    (TR8350.2, equations 4-1 and 4-3).
    """
    semi_minor = SEMI_MAJOR_M * (1.0 - FLATTENING)
    sin2 = np.sin(lat) ** 2
    k = semi_minor * _GAMMA_POLE / (SEMI_MAJOR_M * _GAMMA_EQUATOR) - 1.0
    on_ellipsoid = _GAMMA_EQUATOR * (1.0 + k * sin2) / np.sqrt(1.0 - ECCENTRICITY_2 * sin2)
    m = (EARTH_RATE * SEMI_MAJOR_M) ** 2 * semi_minor / _GM
    ratio = height / SEMI_MAJOR_M
    linear = 2.0 * (1.0 + FLATTENING + m - 2.0 * FLATTENING * sin2)
    return np.asarray(on_ellipsoid * (1.0 - linear * ratio + 3.0 * ratio**2))


def earth_rate_ned(lat: Array) -> Array:
    """Earth's rotation [n, 3], rad/s, in north, east, down axes."""
    zero = np.zeros_like(lat)
    return np.column_stack([EARTH_RATE * np.cos(lat), zero, -EARTH_RATE * np.sin(lat)])


def transport_rate_ned(lat: Array, height: Array, vel_ned: Array) -> Array:
    """Rotation [n, 3], rad/s, of north, east, down axes that move with ``vel_ned`` [n, 3]."""
    east = vel_ned[:, 1] / (normal_radius(lat) + height)
    north = vel_ned[:, 0] / (meridian_radius(lat) + height)
    return np.column_stack([east, -north, -east * np.tan(lat)])
