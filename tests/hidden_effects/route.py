"""Random roads and the way a car is driven along them, as coefficients of smooth splines."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tests.hidden_effects.geodesy import Array

STEP_M = 1.0
"""Spacing of curvature, grade and bank along the road."""
STEP_S = 0.1
"""Spacing of speed in time."""
MARGIN_S = 4.0
"""The motion is defined this long before and after the recording."""


@dataclass(frozen=True)
class Style:
    """How a drive is driven.

    ``lateral`` and ``braking``, ``accelerating`` m/s^2 at most; ``cruise`` m/s on open road;
    ``stop_every_m`` mean distance of stops; ``grade`` and ``bank`` rad, one sigma;
    ``roll_gradient`` and ``pitch_gradient`` rad/(m/s^2) of the suspension; ``wobble`` rad, one
    sigma of the body's small angles against its path; ``circles`` whether a slow tight circle
    is driven, ``roundabouts`` their share among the junctions.
    """

    cruise: float = 14.0
    lateral: float = 2.5
    braking: float = 2.0
    accelerating: float = 1.6
    stop_every_m: float = 350.0
    grade: float = 0.02
    bank: float = 0.015
    roll_gradient: float = 0.006
    pitch_gradient: float = 0.0
    wobble: float = 1e-3
    circles: bool = False
    roundabouts: float = 0.2
    rural: bool = False


@dataclass(frozen=True)
class Plan:
    """Coefficients of the motion.

    ``curvature`` 1/m, ``grade`` rad (uphill positive), ``bank`` rad (right side down) every
    STEP_M; ``speed`` m/s every STEP_S from -MARGIN_S on. ``heading`` rad at the start.
    """

    curvature: Array
    grade: Array
    bank: Array
    speed: Array
    heading: float
    style: Style
    stops_s: tuple[tuple[float, float], ...] = field(default=())


def draw_style(rng: np.random.Generator, rough: bool) -> Style:
    """A random driver, car and region; ``rough`` for a soft suspension on a bad road."""
    rural = bool(rng.random() < 0.35)
    return Style(
        cruise=float(rng.uniform(18.0, 27.0) if rural else rng.uniform(10.0, 17.0)),
        lateral=float(rng.uniform(1.8, 3.8)),
        braking=float(rng.uniform(1.5, 3.2)),
        accelerating=float(rng.uniform(1.0, 2.5)),
        stop_every_m=float(rng.uniform(500.0, 1200.0) if rural else rng.uniform(150.0, 450.0)),
        grade=float(rng.uniform(0.005, 0.04)),
        bank=float(rng.uniform(0.003, 0.025)),
        roll_gradient=float(rng.uniform(0.003, 0.009)),
        pitch_gradient=float(rng.uniform(0.001, 0.003)) if rough else 0.0,
        wobble=float(np.exp(rng.uniform(*np.log([1e-3, 4e-3] if rough else [2e-4, 1.5e-3])))),
        circles=bool(rng.random() < 0.3),
        roundabouts=float(rng.uniform(0.0, 0.4)),
        rural=rural,
    )


def draw_plan(rng: np.random.Generator, style: Style, seconds: float) -> Plan:
    """A random road long enough for ``seconds`` and the speed along it."""
    length = 1.2 * style.cruise * (seconds + 2.0 * MARGIN_S) + 400.0
    curvature, limit = _road(rng, style, length)
    stops = np.cumsum(rng.uniform(0.4, 1.6, 400) * style.stop_every_m)
    speed, rests = _drive(rng, style, curvature, limit, stops, seconds)
    n = len(curvature)
    return Plan(
        curvature=curvature,
        grade=_wander(rng, n, style.grade, 60.0),
        bank=_wander(rng, n, style.bank, 40.0),
        speed=speed,
        heading=float(rng.uniform(-np.pi, np.pi)),
        style=style,
        stops_s=tuple(rests),
    )


def _road(rng: np.random.Generator, style: Style, length: float) -> tuple[Array, Array]:
    """Curvature [n] and speed limit [n] every STEP_M."""
    pieces: list[tuple[float, float, float]] = []  # length m, curvature 1/m, limit m/s
    total = 0.0

    def add(metres: float, kappa: float, limit: float) -> None:
        nonlocal total
        pieces.append((metres, kappa, limit))
        total += metres

    circle_at = rng.uniform(60.0, 400.0) if style.circles else np.inf
    while total < length:
        straight = rng.uniform(60.0, 500.0) if style.rural else rng.uniform(30.0, 220.0)
        limit = style.cruise * rng.uniform(0.7, 1.15)
        add(straight, rng.normal(0.0, 2e-4), limit)
        side = rng.choice([-1.0, 1.0])
        kind = rng.random()
        if total > circle_at:
            radius = rng.uniform(5.5, 9.0)
            add(2.0 * np.pi * radius * rng.uniform(1.5, 3.5), side / radius, 4.0)
            circle_at = np.inf
        elif kind < style.roundabouts:
            radius = rng.uniform(10.0, 22.0)
            # enter to one side, around the island to the other, leave
            traffic = 1.0
            add(0.5 * radius, -traffic / (0.8 * radius), 9.0)
            add(radius * rng.choice([1.2, 2.6, 4.2]), traffic / radius, 9.0)
            add(0.5 * radius, -traffic / (0.8 * radius), 9.0)
        elif kind < 0.6 and not style.rural:
            radius = rng.uniform(7.0, 25.0)
            add(radius * np.radians(rng.uniform(60.0, 110.0)), side / radius, 12.0)
        elif kind < 0.7:
            shift = rng.uniform(15.0, 30.0)  # a change of lane
            add(shift, side * 4e-3, limit)
            add(shift, -side * 4e-3, limit)
        else:
            radius = rng.uniform(60.0, 400.0) if style.rural else rng.uniform(30.0, 120.0)
            add(radius * np.radians(rng.uniform(15.0, 100.0)), side / radius, limit)
    counts = [max(1, round(metres / STEP_M)) for metres, _, _ in pieces]
    kappa = np.repeat([piece[1] for piece in pieces], counts)
    limit_m_s = np.repeat([piece[2] for piece in pieces], counts)
    return _smooth(kappa, 5), limit_m_s


def _smooth(values: Array, width: int) -> Array:
    """Twice a moving average of ``width`` samples."""
    box = np.full(width, 1.0 / width)
    padded = np.pad(values, width, mode="edge")
    return np.convolve(np.convolve(padded, box, "same"), box, "same")[width:-width]


def _wander(rng: np.random.Generator, n: int, sd: float, length: float) -> Array:
    """A smooth random function [n] of correlation ``length`` in samples."""
    white = rng.normal(0.0, 1.0, n + 8 * int(length))
    out = _smooth(_smooth(white, int(length)), int(length))[4 * int(length) :][:n]
    return np.asarray(out * sd / max(float(out.std()), 1e-12))


def _drive(
    rng: np.random.Generator,
    style: Style,
    curvature: Array,
    limit: Array,
    stops: Array,
    seconds: float,
) -> tuple[Array, list[tuple[float, float]]]:
    """Speed every STEP_S and the (begin, end) of standstills, in seconds of the recording."""
    n = len(curvature)
    mood = 1.0 + _wander(rng, n, 0.06, 50.0)
    allowed = np.minimum(
        limit * np.clip(mood, 0.75, 1.2),
        np.sqrt(style.lateral / np.maximum(np.abs(curvature), 1e-5)),
    )
    for i in range(n - 2, -1, -1):
        allowed[i] = min(allowed[i], np.sqrt(allowed[i + 1] ** 2 + 2.0 * style.braking * STEP_M))
    steps = round((seconds + 2.0 * MARGIN_S) / STEP_S) + 1
    speed = np.zeros(steps)
    rests: list[tuple[float, float]] = []
    at, v, stop = 0.0, 0.0, 0
    first = rng.uniform(2.0, 10.0)
    wait = round((MARGIN_S + first) / STEP_S)
    rests.append((-MARGIN_S, first))
    for k in range(steps):
        if wait > 0:
            wait -= 1
            continue
        left = stops[stop] - at
        if left < 0.25 or (left < 2.0 and v < 0.3):
            hold = rng.uniform(3.0, 12.0)
            rests.append((k * STEP_S - MARGIN_S, k * STEP_S - MARGIN_S + hold))
            v, wait, stop = 0.0, round(hold / STEP_S), stop + 1
            continue
        most = min(allowed[min(int(at / STEP_M), n - 1)], np.sqrt(2.0 * style.braking * left))
        v = min(v + style.accelerating * STEP_S, max(most, 0.25))
        speed[k] = v
        at += v * STEP_S
    return np.maximum(_smooth(speed, 5), 0.0), rests
