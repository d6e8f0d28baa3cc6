"""The dictionary of formulas: physical quantities on every axis of the sensors and on the fixes.

One of a family: from there the others are found (``forms``).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from automap.effects import CATALOGUE, Signals, extra_basis, imu_terms
from automap.effects.formula_text import parse_formula
from automap.effects.imu import BASIS_EXTRA, BASIS_ONE
from automap.effects.terms import WARM_UP
from automap.effects.user import (
    INERTIAL,
    OF_FIXES,
)
from automap.gap.candidates import PREFIX
from automap.gap.columns import signal_column, size_of, usual_sds
from automap.gap.fit import Fit
from automap.gap.limits import SAME_SIGNAL
from automap.gap.linear import Column
from automap.gap.nodes import NodeMotion
from automap.records import FloatArray

QUANTITIES = (
    "speed",
    "speed^3",
    "sin(heading)",
    "cos(heading)",
    "sin(2 * heading)",
    "cos(2 * heading)",
    "abs(rate_z)",
    "rate_z^2",
    "rate_z * speed",
    "force_x^2",
    "force_y^2",
    "force_x * force_y",
    "force_x * rate_z",
    "force_y * rate_z",
    "force_x * speed",
    "force_y * speed",
    "force_x^3",
    "force_y^3",
    "rate_z^3",
    "max(force_x, 0)",
    "max(force_y, 0)",
    "rate^2",
    "rate_y^2",
    # a rotor of unequal inertias
    "rate_x * rate_z",
    "rate_y * rate_z",
    "tanh(acceleration / 0.1)",
    # one axis late by itself, and where inside the housing an axis is
    "angular_acceleration_x",
    "angular_acceleration_y",
    "angular_acceleration_z",
    "jerk_x",
    "jerk_y",
    "jerk_z",
    # what is odd in a quantity says nothing of what is even in it
    "abs(jerk_x)",
    "abs(jerk_y)",
    "time",
    # what sun or standing air warms at rest, and wind cools
    "lag(step(1 - speed), 20.0)",
    "lag(speed, 20.0)",
)
MOTION = "speed", "acceleration", "abs(acceleration)", "lateral_acceleration", "abs(rate_z)"
ON_FIXES = (
    *(
        (on, text)
        for on in OF_FIXES
        for text in MOTION
        # a latency, a lever arm and a factor on velocities say these already
        if (on, text)
        not in {
            ("velocity_along", "speed"),
            ("position_along", "speed"),
            ("velocity_along", "acceleration"),
            ("velocity_across", "lateral_acceleration"),
        }
    ),
    # heights that are late, or are smoothed as they rise
    ("height", "climb"),
    # an antenna's own bearing, and what stands around it in the car
    ("height", "sin(heading)"),
    ("height", "cos(heading)"),
    ("velocity_along", "speed^2"),
    # too high or low by as much, but from some speed on
    ("velocity_along", "tanh(speed / 5.0)"),
    ("position_along", "speed^2"),
    # courses that a compass has a say in
    ("velocity_across", "speed * sin(heading)"),
    ("velocity_across", "speed * cos(heading)"),
)
REMEMBERED = (
    # an axis that hangs behind what it measures by a play: hysteresis
    *((f"accel_{a}", f"(force_{a} - play(force_{a}, 0.5))") for a in "xy"),
    ("gyro_z", "(rate_z - play(rate_z, 0.05))"),
    # courses that a receiver holds until they have turned by more, and that hang behind by so much
    ("velocity_across", "(speed * (heading - play(heading, 0.01)))"),
    # receivers that run on; of velocities that is what a low-pass does, which has a name
    ("position_along", "lag(acceleration, 2.0)"),
    ("position_across", "lag(lateral_acceleration, 2.0)"),
)
"""Formulas of what has been: channel and text. Widths and times are refined where one is found."""
ON_VEHICLE = (
    # slips that do not grow with the force alone, a torque, a wind, an axle that bends under load
    ("nhc_y", "speed * lateral_acceleration^3"),
    ("nhc_y", "speed^2 * lateral_acceleration"),
    ("nhc_y", "speed * acceleration"),
    ("nhc_y", "speed * sin(heading)"),
    ("nhc_y", "speed * cos(heading)"),
)
"""What the point that follows the road does aside: channel and text."""
ON_MOUNT = (
    # wind lifts what stands out, brakes and bends twist what is held on one side or bends to both
    *(
        (on, text)
        for on in ("imu_pitch", "imu_yaw")
        for text in ("speed^2", "abs(acceleration)", "lateral_acceleration", "abs(rate_z) * speed")
    ),
    ("imu_yaw", "acceleration"),
    # dampers let a nose dive late; at once is in every model
    ("imu_pitch", "lag(acceleration, 1.0)"),
)
"""What the unit gives by in its mount: channel and text."""
WARM_MOUNT = ("imu_pitch", "imu_yaw")
"""What adhesive and plastic let go of in the sun."""
ALONE = (*ON_FIXES, *REMEMBERED, *ON_VEHICLE, *ON_MOUNT)
"""Formulas that are tried on their own channel only."""


def warm(fit: Fit) -> bool:
    """Whether a drive has temperatures."""
    temperature = fit.opened.drive.imu.temp_c
    return temperature is not None and bool(np.isfinite(temperature).any())


def formula_terms(signals: Signals, has_temperature: bool) -> list[tuple[str, str]]:
    """The dictionary for drives like one of these signals: channel and text of each."""
    texts, alone = list(QUANTITIES), list(ALONE)
    if has_temperature:
        rise = f"(temperature - {float(np.median(signals.temperature)):.1f})"
        # of a sensor whose core follows its case, what lies between the two
        texts += [f"{rise}^2", "(temperature - lag(temperature, 40.0))", f"{rise} * speed"]
        # what is stated of a mount was so before it warmed
        since = f"(temperature - {float(signals.temperature[0]):.1f})"
        alone += [(on, since) for on in WARM_MOUNT]
    return [*((on, text) for text in texts for on in INERTIAL), *alone]


LEAST_SPREAD = 1e-9
"""Of a quantity that a drive has at all."""
LEAST_OWN = 1e-6
"""Share of a signal's variance below which the others make it up."""


def formula_columns(
    at: NodeMotion, terms: Sequence[tuple[str, str]], exclude: Collection[str]
) -> Iterator[Column]:
    """Formulas of one term each, channel and text, as columns of one drive, but for those of
    readings that effects of the library say; it does without those to ``exclude``. One by one, for
    signals are as long as the drive."""
    channels: dict[str, list[str]] = {}
    for on, text in terms:
        channels.setdefault(text, []).append(on)
    made: dict[tuple[str, str], Column] = {}
    for term in terms:
        text = term[1]
        its = channels.pop(text, [])
        signal = parse_formula(text)(at.along) if its else np.zeros(0)
        if its and np.isfinite(signal).all():
            sds = usual_sds(its, signal)
            for on in its:
                # a car that never turns has no bend to remember
                said = on in INERTIAL and _said(at, on, signal, exclude)
                if sds[on] < size_of(on) / LEAST_SPREAD and not said:
                    made[on, text] = signal_column((on, text), signal, at, sd=sds[on])
        if term in made:
            yield made.pop(term)


def _said(at: NodeMotion, on: str, signal: FloatArray, exclude: Collection[str]) -> bool:
    """Whether effects of the catalogue make up a ``signal`` [n] on the readings ``on``."""
    without = frozenset(exclude)
    if without not in at.said:
        at.said[without] = _catalogue_signals(at, exclude)
    rows = at.said[without].get(on)
    if rows is None:
        return False
    thin = signal[:: at.every]
    # they have no mean
    share = np.sum((rows @ thin / len(thin)) ** 2) / max(float(np.var(thin)), 1e-300)
    return bool(share > SAME_SIGNAL**2)


def _catalogue_signals(at: NodeMotion, exclude: Collection[str]) -> dict[str, FloatArray]:
    """What catalogue effects already add to each channel: signals [k, m] of mean square one that
    are at right angles to one another, at the readings that are compared."""
    # what a search has made an effect of stays a formula
    out_of = [e for e in CATALOGUE if e not in exclude and not e.startswith(PREFIX)]
    names = [e for e in out_of if CATALOGUE[e].family == "imu"]
    terms = imu_terms(names)
    motion, temp_c = at.motion, at.fit.opened.drive.imu.temp_c
    speed = np.linalg.norm(motion.vel, axis=1)
    extra = extra_basis(terms, motion.rate, motion.force, temp_c, speed, signals=at.along)
    both, extra = (
        each[:: at.every] for each in (np.concatenate([motion.rate, motion.force], axis=1), extra)
    )
    out: dict[str, list[FloatArray]] = {}
    for term in terms:
        if term.basis == BASIS_ONE or term.extra == WARM_UP:
            # a decay of a time constant of its own says more than the catalogue's with others
            continue
        raw = both[:, term.basis - 1] if term.basis < BASIS_EXTRA else extra[:, term.basis - 7]
        size = float(raw.std())
        if size > 1e-12:
            channel = INERTIAL[(0 if term.sensor == 0 else 3) + term.axis]
            out.setdefault(channel, []).append((raw - raw.mean()) / size)
    return {channel: _at_right_angles(rows) for channel, rows in out.items()}


def _at_right_angles(rows: Sequence[FloatArray]) -> FloatArray:
    """What spans the same as unit signals [k][n], by Gram and Schmidt: [at most k, n]."""
    out = np.empty((len(rows), len(rows[0])))
    count = 0
    for row in rows:
        before = out[:count]
        own = row - (before @ row / len(row)) @ before
        size = float(own @ own) / len(own)
        if size > LEAST_OWN:
            out[count] = own / np.sqrt(size)
            count += 1
    return out[:count]
