"""The dictionary of formulas: physical quantities on every axis of the sensors and on the fixes."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from automap.effects import CATALOGUE, extra_basis, imu_terms
from automap.effects.imu import BASIS_EXTRA, BASIS_FORCE, BASIS_ONE, ImuTerm
from automap.fusion.layout import CH_POS, CH_VEL, MAX_SCALARS
from automap.gap.columns import Column, Direct, Inertial, NodeMotion, effect_columns
from automap.gap.fit import Fit, Motion
from automap.records import FloatArray

CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
SIZES = {"gyro": 5e-4, "accel": 0.05, "position": 0.5, "height": 0.5, "velocity": 0.05}
"""Prior sd of a formula's rms size: rad/s, m/s^2, m, m, m/s."""
DECAYS = (0.05, 0.1, 0.15, 0.2, 0.3)
STEPS = 16
ALIKE = 0.999
"""A quantity that correlates so with a catalogue effect's is that effect."""


def quantities(fit: Fit, motion: Motion) -> Iterator[tuple[str, FloatArray]]:
    """Names and signals [n] of the physical quantities along a drive."""
    v = np.linalg.norm(motion.vel, axis=1)
    heading = np.arctan2(motion.dcm[:, 1, 0], motion.dcm[:, 0, 0])
    w, f = motion.rate, motion.force
    length = float(motion.t[-1] - motion.t[0])
    x = (motion.t - motion.t[0]) / length
    yield "speed", v
    yield "speed^3", v**3
    yield "sin(heading)", np.sin(heading)
    yield "cos(heading)", np.cos(heading)
    yield "sin(2 heading)", np.sin(2.0 * heading)
    yield "cos(2 heading)", np.cos(2.0 * heading)
    yield "|rate_z|", np.abs(w[:, 2])
    yield "rate_z^2", w[:, 2] ** 2
    yield "rate_z * speed", w[:, 2] * v
    yield "force_x^2", f[:, 0] ** 2
    yield "force_y^2", f[:, 1] ** 2
    yield "force_x * force_y", f[:, 0] * f[:, 1]
    yield "force_x * rate_z", f[:, 0] * w[:, 2]
    yield "force_y * rate_z", f[:, 1] * w[:, 2]
    yield "force_x * speed", f[:, 0] * v
    yield "force_y * speed", f[:, 1] * v
    yield "force_x^3", f[:, 0] ** 3
    yield "force_y^3", f[:, 1] ** 3
    yield "rate_z^3", w[:, 2] ** 3
    yield "max(force_x, 0)", np.maximum(f[:, 0], 0.0)
    yield "min(force_x, 0)", np.minimum(f[:, 0], 0.0)
    yield "max(force_y, 0)", np.maximum(f[:, 1], 0.0)
    yield "max(rate_z, 0)", np.maximum(w[:, 2], 0.0)
    yield "|force_x|", np.abs(f[:, 0])
    yield "|force_y|", np.abs(f[:, 1])
    yield "rate^2", np.sum(w**2, axis=1)
    yield "rate_y^2", w[:, 1] ** 2
    along = np.einsum("ni,ni->n", motion.dcm[:, :, 0], motion.acc)
    yield "sign(acceleration)", np.tanh(along / 0.1)
    yield "sign(rate_z)", np.tanh(w[:, 2] / 0.01)
    yield "time", x
    yield "time^2", x**2
    temperature = fit.opened.drive.imu.temp_c
    if temperature is not None and np.isfinite(temperature).any():
        rise = np.nan_to_num(temperature - np.nanmedian(temperature))
        yield "temperature^2", rise**2
        yield "temperature rate", np.gradient(rise, motion.t)
        yield "temperature * speed", rise * v
    for share in DECAYS:
        yield f"exp(-t / {share * length:.0f} s)", np.exp(-x / share)
    for i in range(1, STEPS):
        yield f"step at {i / STEPS * length:.0f} s", (x > i / STEPS).astype(float)


def formula_columns(
    fit: Fit, motion: Motion, at: NodeMotion, exclude: Collection[str]
) -> list[Column]:
    """All formulas as columns; ``effect`` is the channel, ``parameter`` the text."""
    known = _catalogue_signals(fit, motion, exclude)
    out: list[Column] = []
    for text, signal in quantities(fit, motion):
        size = float(np.std(signal))
        if size < 1e-12:
            continue
        unit = (signal - signal.mean()) / size
        for i, channel in enumerate(CHANNELS):
            if any(abs(float(np.mean(unit * u))) > ALIKE for u in known.get(channel, ())):
                continue
            sensor, axis = (0, i) if i < 3 else (1, i - 3)
            sd = SIZES[channel[:-2]] / size
            out.append(Column(channel, text, sd, (Inertial(sensor, axis, signal),)))
    out += _fix_columns(at)
    for effect in exclude:
        if effect in CATALOGUE and CATALOGUE[effect].family in ("imu", "gnss", "vehicle", "clock"):
            sds = {p.name: p.prior_sd for p in CATALOGUE[effect].parameters}
            for column in effect_columns(effect, fit, motion, at, sds):
                out.append(_as_formula(column))
    return out


def _as_formula(column: Column) -> Column:
    """A column of an effect that the library does without, told as a formula."""
    if not column.inertial:
        text = column.parameter
        return Column(f"fixes ({column.effect})", text, column.prior_sd, direct=column.direct)
    part = column.inertial[0]
    channel = CHANNELS[3 * part.sensor + part.axis]
    term: ImuTerm = next(
        t for t in imu_terms([column.effect]) if t.parameter.name == column.parameter
    )
    return Column(channel, _basis_text(term), column.prior_sd, column.inertial)


def _basis_text(term: ImuTerm) -> str:
    if term.basis == BASIS_ONE:
        return "1"
    if term.basis < BASIS_FORCE:
        return f"rate_{'xyz'[term.basis - 1]}"
    if term.basis < BASIS_EXTRA:
        return f"force_{'xyz'[term.basis - BASIS_FORCE]}"
    words = {"temperature": "temperature", "speed_squared": "speed^2"}
    if term.extra in words:
        return words[term.extra]
    kind, source, axis = str(term.extra).split("_")
    name = f"{source}_{axis}"
    return f"|{name}|" if kind == "abs" else f"{name}^2"


def _catalogue_signals(
    fit: Fit, motion: Motion, exclude: Collection[str]
) -> dict[str, list[FloatArray]]:
    """Unit signals that catalogue effects already add to each channel."""
    names = [e for e in CATALOGUE if CATALOGUE[e].family == "imu" and e not in exclude]
    terms = imu_terms(names)
    speed = np.linalg.norm(motion.vel, axis=1)
    extra = extra_basis(terms, motion.rate, motion.force, fit.opened.drive.imu.temp_c, speed)
    both = np.concatenate([motion.rate, motion.force], axis=1)
    out: dict[str, list[FloatArray]] = {}
    for term in terms:
        if term.basis == BASIS_ONE:
            continue
        raw = both[:, term.basis - 1] if term.basis < BASIS_EXTRA else extra[:, term.basis - 7]
        size = float(raw.std())
        if size > 1e-12:
            channel = CHANNELS[(0 if term.sensor == 0 else 3) + term.axis]
            out.setdefault(channel, []).append((raw - raw.mean()) / size)
    return out


def _fix_columns(at: NodeMotion) -> list[Column]:
    """Formulas on the fixes: along and across the track, height, and velocities."""
    v = np.hypot(at.vel[:, 0], at.vel[:, 1])
    along = np.stack([at.dcm[:, 0, 0], at.dcm[:, 1, 0], np.zeros(len(v))], axis=1)
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    across = np.stack([-along[:, 1], along[:, 0], np.zeros(len(v))], axis=1)
    down = np.zeros_like(along)
    down[:, 2] = 1.0
    forward = np.einsum("ki,ki->k", at.dcm[:, :, 0], at.acc)
    lateral = np.einsum("ki,ki->k", at.dcm[:, :, 1], at.acc)
    amounts = {
        "speed": v,
        "speed^2": v**2,
        "acceleration": forward,
        "lateral acceleration": lateral,
        "|turn rate|": np.abs(at.rate[:, 2]),
    }
    places: list[tuple[str, str, int, FloatArray]] = [
        ("position along", "position", CH_POS, along),
        ("position across", "position", CH_POS, across),
        ("height", "height", CH_POS, -down),
        ("velocity along", "velocity", CH_VEL, along),
        ("velocity across", "velocity", CH_VEL, across),
        ("velocity down", "velocity", CH_VEL, down),
    ]
    # a latency and a lever arm say these already
    told = {
        ("position along", "speed"),
        ("velocity along", "acceleration"),
        ("velocity across", "lateral acceleration"),
    }
    out = []
    for channel, kind, first, direction in places:
        for text, amount in amounts.items():
            if (channel, text) in told:
                continue
            by_channel = np.zeros((len(v), MAX_SCALARS))
            by_channel[:, first : first + 3] = amount[:, None] * direction
            sd = SIZES[kind] / max(float(amount.std()), 1e-9)
            out.append(Column(channel, text, sd, direct=Direct(by_channel)))
    return out
