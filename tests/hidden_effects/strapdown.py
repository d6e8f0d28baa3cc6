"""A plain strapdown integrator, to check that ideal readings give the motion back.

Fourth-order Runge-Kutta over pairs of samples on the whole state. Reference: Groves, 2nd
edition, section 5.4.
"""

from __future__ import annotations

import numpy as np

from tests.hidden_effects.geodesy import (
    Array,
    earth_rate_ned,
    meridian_radius,
    normal_gravity,
    normal_radius,
    transport_rate_ned,
)
from tests.hidden_effects.motion import State

Whole = tuple[Array, Array, Array]


def integrate(start: State, force: Array, rate: Array, dt: float) -> tuple[Array, Array, Array]:
    """Latitude, longitude, height [m, 3], velocity [m, 3] and C_n_b [m, 3, 3] at every second
    sample, from row 0 of ``start`` and readings ``force``, ``rate`` [2 m - 1, 3] every ``dt``."""
    steps = (len(force) - 1) // 2
    place = np.array([start.lat[0], start.lon[0], start.height[0]])
    vel, C = start.vel_ned[0].copy(), start.C_n_b[0].copy()
    places, vels, turns = [place], [vel], [C]

    def slope(p: Array, v: Array, M: Array, f: Array, w: Array) -> Whole:
        lat, height = p[:1], p[2:]
        earth = earth_rate_ned(lat)[0]
        transport = transport_rate_ned(lat, height, v[None])[0]
        north = v[0] / (meridian_radius(lat)[0] + height[0])
        east = v[1] / ((normal_radius(lat)[0] + height[0]) * np.cos(lat[0]))
        gravity = np.array([0.0, 0.0, normal_gravity(lat, height)[0]])
        dv = M @ f + gravity - _cross(2.0 * earth + transport) @ v
        dM = M @ _cross(w) - _cross(earth + transport) @ M
        return np.array([north, east, -v[2]]), dv, dM

    def moved(state: Whole, rates: Whole, by: float) -> Whole:
        return state[0] + by * rates[0], state[1] + by * rates[1], state[2] + by * rates[2]

    h = 2.0 * dt
    for k in range(steps):
        f, w = force[2 * k : 2 * k + 3], rate[2 * k : 2 * k + 3]
        now = (place, vel, C)
        a = slope(*now, f[0], w[0])
        b = slope(*moved(now, a, 0.5 * h), f[1], w[1])
        c = slope(*moved(now, b, 0.5 * h), f[1], w[1])
        e = slope(*moved(now, c, h), f[2], w[2])
        for part, share in ((a, 1.0), (b, 2.0), (c, 2.0), (e, 1.0)):
            now = moved(now, part, share * h / 6.0)
        place, vel, C = now
        places.append(place)
        vels.append(vel)
        turns.append(C)
    return np.array(places), np.array(vels), np.array(turns)


def _cross(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
