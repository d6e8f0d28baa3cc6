"""Velocities out of the messages that have them."""

from __future__ import annotations

import numpy as np

from automap.earth import ecef_axes
from automap.io.epoch_source import Epochs, Source, select
from automap.records import BoolArray, FloatArray

KNOT = 1852.0 / 3600.0

STANDSTILL_SPEED = 0.1
"""Speed (m/s) under which a missing course means standing still and not an unknown velocity;
receivers leave the course out at standstill."""

_ORDER = ("NAV-PVT", "NAV-VELNED", "NAV-SOL", "PUBX00", "RMC", "VTG")


def velocities(
    sources: dict[str, Source], valid: BoolArray, lat: FloatArray, lon: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Velocity NED and its sd [n, 3] of the ``valid`` epochs [n], NaN where unknown."""
    n = len(valid)
    velocity, sd = np.empty((n, 3)), np.empty((n, 3))
    missing = np.ones(n, bool)
    open_ = valid.copy()
    for name in _ORDER:
        if name not in sources:
            continue
        source = sources[name]
        mask = open_ & source.has
        if not mask.any():
            continue
        epochs = select(mask)
        if name in ("NAV-PVT", "NAV-VELNED"):
            parts = [source.value(f, epochs) for f in ("velN", "velE", "velD")]
        elif name == "NAV-SOL":
            along = [source.value(f, epochs) for f in ("ecefVX", "ecefVY", "ecefVZ")]
            axes = ecef_axes(lat[epochs], lon[epochs])
            parts = list(np.einsum("jn,nji->in", along, axes))
        else:
            parts = _from_course(source, epochs)
        for axis, part in enumerate(parts):
            velocity[epochs, axis] = part
        if name.startswith("NAV-"):
            sd[epochs] = (source.value("sAcc", epochs) / np.sqrt(3.0))[:, None]
        else:
            sd[epochs] = np.nan
        missing[epochs] = False
        open_[epochs] = ~np.isfinite(parts[0])
    if missing.any():
        velocity[missing] = np.nan
        sd[missing] = np.nan
    return velocity, sd


def _from_course(source: Source, epochs: Epochs) -> list[FloatArray]:
    """Velocity N, E, D, each [k], of a sentence with speed and course over ground."""
    speed_field, course_field, unit = {
        "RMC": ("spd", "cog", KNOT),
        "VTG": ("sogk", "cogt", 1.0 / 3.6),
        "PUBX00": ("SOG", "COG", 1.0 / 3.6),
    }[source.name]
    speed = source.value(speed_field, epochs) * unit
    if source.name == "VTG":
        knots = source.value("sogn", epochs) * KNOT
        speed = np.where(np.isfinite(knots), knots, speed)
    course = np.radians(source.value(course_field, epochs))
    course[np.isnan(course) & (speed < STANDSTILL_SPEED)] = 0.0
    down = np.full(len(speed), np.nan)
    if source.name == "PUBX00":
        down = source.value("vVel", epochs)
    return [speed * np.cos(course), speed * np.sin(course), down]
