"""Fixes alone, axis by axis, as the constant-velocity smoother takes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from automap.earth import local_ned
from automap.errors import InputError
from automap.fusion.kernels.axis import smooth_axis
from automap.fusion.kernels.whiten import whiten_axis
from automap.fusion.levels import ROAD_ACCELERATION, VELOCITY_WANDER
from automap.fusion.limits import LEAST_FIXES, ROAD_ACCELERATION_PSD
from automap.fusion.measurements.position import lasting_share
from automap.fusion.nodes import model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.screening import screen_fixes
from automap.gates import gate
from automap.records import BoolArray, Fixes, FloatArray, IntArray

_WHITE_LEVELS = (
    ("position_h", "velocity_h"),
    ("position_h", "velocity_h"),
    ("position_v", "velocity_v"),
)
"""Levels of position and velocity by axis; what lasts of a velocity's error goes with it."""


@dataclass(frozen=True)
class Epochs:
    """What a smoother takes of usable fixes, one row an instant: ``t`` [k] s, ``z`` and ``used``
    [3, k, 2] position m and velocity m/s of each axis and which are there, ``stated_sd`` [k, 3] m,
    ``white`` [3, k, 2] sigmas; ``row`` [k] of the fixes, ``ref`` the origin, lat, lon, height."""

    t: FloatArray
    z: FloatArray
    used: BoolArray
    stated_sd: FloatArray
    white: FloatArray
    row: IntArray
    ref: tuple[float, float, float]


def usable_epochs(fixes: Fixes, options: FusionOptions) -> Epochs:
    """Those of fixes that are not wild.

    Raises:
        InputError: fewer than two usable fixes.
    """
    t_all = fixes.gps_s - np.nanmin(fixes.gps_s) if len(fixes) else np.zeros(0)
    model = model_fixes(fixes, np.asarray(t_all), options)
    model = screen_fixes(model, options.wander_tau_s).fixes
    has = (model.flags & 1) > 0
    if int(has.sum()) < LEAST_FIXES:
        raise InputError(
            f"only {int(has.sum())} fixes have a position; the receiver had no view of the sky or "
            "the log is cut: check it with 'automap check'"
        )
    keep = np.concatenate([[True], np.diff(model.t) > 0])
    rows = np.flatnonzero(keep)
    t, values, flags = model.t[rows], model.values[rows], model.flags[rows]
    first = int(np.flatnonzero(has[rows])[0])
    has_height = np.flatnonzero((flags & 2) > 0)
    height0 = float(values[has_height[0], 2]) if len(has_height) else 0.0
    ref = (float(values[first, 0]), float(values[first, 1]), height0)
    height = np.where((flags & 2) > 0, values[:, 2], height0)
    ned = local_ned(values[:, 0], values[:, 1], height, ref).reshape(-1, 3)
    z = np.stack([ned, values[:, 3:6]], axis=-1).transpose(1, 0, 2)
    used = np.stack([np.column_stack([flags & b, flags & 4 * b]) > 0 for b in (1, 1, 2)])
    white = np.sqrt(np.stack([model.white_var[rows][:, [axis, 3 + axis]] for axis in range(3)]))
    return Epochs(t, z, used, model.stated_sd[rows], white, model.row[rows], ref)


def smooth_epochs(
    at: Epochs, axis: int, options: FusionOptions, factors: Mapping[str, float], out: FloatArray
) -> float:
    """One axis into ``out`` [k, 4]; returns the likelihood of its innovations in nats."""
    z = np.ascontiguousarray(at.z[axis])
    return float(smooth_axis(at.t, z, *_noise(at, axis, options, factors), out))


def whitened_epochs(
    at: Epochs,
    axis: int,
    options: FusionOptions,
    factors: Mapping[str, float],
    errors: FloatArray,
) -> FloatArray:
    """What the filter of one axis does not expect of the fixes and of ``errors`` [k, 2, c] of their
    positions, m, and velocities, m/s: innovations over their sigmas [m, 1 + c], a row for each
    measurement in the order of time, those of the fixes first."""
    z = np.concatenate([at.z[axis][..., None], errors], axis=2)
    out = np.zeros_like(z)
    whiten_axis(at.t, z, *_noise(at, axis, options, factors), out)
    return np.asarray(out[at.used[axis]])


def _noise(
    at: Epochs, axis: int, options: FusionOptions, factors: Mapping[str, float]
) -> tuple[BoolArray, FloatArray, FloatArray, float, tuple[float, float], float]:
    """What kernels want to know of one axis."""
    position, velocity = (factors.get(level, 1.0) for level in _WHITE_LEVELS[axis])
    white = np.ascontiguousarray(at.white[axis]) * [position, velocity]
    # what a receiver's own filter leaves in a velocity is as large as what it says, and lasts,
    # where no IMU has told how large
    lasting = np.maximum(white[:, 1], velocity * options.velocity_wander_sd)
    if VELOCITY_WANDER in factors:
        lasting = np.full_like(lasting, factors[VELOCITY_WANDER] * options.velocity_wander_sd)
    share = lasting_share(options, factors)[axis]
    return (
        np.ascontiguousarray(at.used[axis]),
        white**2,
        np.column_stack([share * at.stated_sd[:, axis], lasting]),
        ROAD_ACCELERATION_PSD[axis] * factors.get(ROAD_ACCELERATION, 1.0) ** 2,
        (options.wander_tau_s, options.velocity_wander_tau_s),
        gate(options.gate_probability, 1),
    )
