"""The route as a curve: curvature, grade, bank and allowed speed over the distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from automap.records import FloatArray
from automap.simulation.scenario import Route, Vehicle

STEP_M = 0.05
"""Distance between points of a route."""
_HOLD_MARGIN_S = 0.01
"""A stop ends so much before its time, so that knots of the speed stay apart."""


@dataclass(frozen=True)
class RouteProfile:
    """Curves over distance ``s`` [n] m, equally spaced by ``STEP_M``.

    ``curvature`` 1/m (right positive), ``slope`` rad (uphill positive), ``bank`` rad (right
    side down positive), ``speed`` m/s that the vehicle reaches there.
    """

    s: FloatArray
    curvature: FloatArray
    slope: FloatArray
    bank: FloatArray
    speed: FloatArray


def profile_route(route: Route, vehicle: Vehicle) -> RouteProfile:
    """Join the legs smoothly and find the speed that accelerations and halts allow."""
    lengths = np.array(
        [
            leg.length_m if leg.radius_m is None else leg.radius_m * abs(np.deg2rad(leg.turn_deg))
            for leg in route.legs
        ]
    )
    s = np.arange(0.0, lengths.sum() + STEP_M / 2, STEP_M)
    leg_of = np.minimum(np.searchsorted(np.cumsum(lengths), s, side="right"), len(lengths) - 1)
    bend = np.array([0.0 if g.radius_m is None else np.sign(g.turn_deg) / g.radius_m
                     for g in route.legs])[leg_of]  # fmt: skip
    slope = np.arctan(np.array([g.grade_percent for g in route.legs])[leg_of] / 100.0)
    bank = np.deg2rad(np.array([g.bank_deg for g in route.legs])[leg_of])
    limit = np.array([g.speed_m_s for g in route.legs])[leg_of]

    # a Gaussian of this width takes about transition_m from one curvature to the next
    width = route.transition_m / 4.0 / STEP_M
    curvature = gaussian_filter1d(bend, width, mode="nearest")
    limit = np.minimum(limit, np.sqrt(vehicle.lateral_accel / np.maximum(np.abs(curvature), 1e-6)))
    return RouteProfile(
        s=s,
        curvature=curvature,
        slope=gaussian_filter1d(slope, 2.0 * width, mode="nearest"),
        bank=gaussian_filter1d(bank, width, mode="nearest"),
        speed=_reachable_speed(s, limit, route, vehicle),
    )


def _reachable_speed(
    s: FloatArray, limit: FloatArray, route: Route, vehicle: Vehicle
) -> FloatArray:
    square = limit**2
    square[[0, -1]] = 0.0
    for stop in route.stops:
        square[min(round(stop.at_m / STEP_M), len(s) - 1)] = 0.0
    gain, loss = 2.0 * vehicle.accel * STEP_M, 2.0 * vehicle.brake * STEP_M
    # v^2 <= v0^2 + 2 a s forwards and backwards: a running minimum of v^2 - 2 a s
    ramp = np.arange(len(s))
    square = np.minimum.accumulate(square - gain * ramp) + gain * ramp
    square = (np.minimum.accumulate((square - loss * ramp[::-1])[::-1]) + loss * ramp)[::-1]
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))


def distance_over_time(
    profile: RouteProfile, route: Route, standstill_s: float
) -> tuple[FloatArray, FloatArray]:
    """Speed over time with the halts: times [m] s from the begin and speeds [m] m/s.

    Speed is linear between the returned times (constant acceleration).
    """
    v = profile.speed
    step = 2.0 * STEP_M / (v[1:] + v[:-1])
    t = standstill_s + np.concatenate([[0.0], np.cumsum(step)])
    times, speeds = [0.0], [0.0]
    held = 0.0
    first = 0
    for stop in sorted(route.stops, key=lambda stop: stop.at_m):
        index = min(round(stop.at_m / STEP_M), len(v) - 1)
        times.extend(t[first : index + 1] + held)
        speeds.extend(v[first : index + 1])
        held += stop.hold_s
        times.append(t[index] + held - _HOLD_MARGIN_S)
        speeds.append(0.0)
        first = index + 1
    times.extend(t[first:] + held)
    speeds.extend(v[first:])
    times.append(times[-1] + route.end_standstill_s)
    speeds.append(0.0)
    return np.array(times), np.array(speeds)
