"""What an effect costs: how far the smoothed path of a drive moves without it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.earth import metres_per_radian
from automap.frames import quat_to_matrix, quat_to_rpy
from automap.fusion.kernel_runs import run_dense
from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit, GapModel, Values
from automap.gap.result import Cost, Extent
from automap.gap.scoring import fit_held_out
from automap.records import FloatArray

STEP_S = 0.1
"""Steps of a path: within so little a car moves much as the states at both ends say, and what a
path takes is a small part of a fit."""


@dataclass(frozen=True)
class HeldPath:
    """A smoothed path by the IMU's stamps: ``t`` [n] s, ``pos`` [n, 3] rad, rad, m of the IMU,
    ``quat`` [n, 4] body to NED."""

    t: FloatArray
    pos: FloatArray
    quat: FloatArray


@dataclass(frozen=True)
class Moved:
    """How far one path is from another at the same stamps: ``t`` [n] s, ``level`` and ``height``
    [n] m (height up), ``heading`` and ``tilt`` [n] rad, the tilt without a sign."""

    t: FloatArray
    level: FloatArray
    height: FloatArray
    heading: FloatArray
    tilt: FloatArray


def held_path(fit: Fit) -> HeldPath:
    """The smoothed path of a fit.

    At the IMU's stamps, not at the filter's nodes: a delay moves these, and between two that are a
    second apart a car in a bend is decimetres off their chord.
    """
    last = fit.last
    dense, _ = run_dense(last.problem, last.nodes, last.smooth.nominal, last.smooth.params, True)
    t = last.problem.t
    every = max(round(STEP_S / max(float(np.median(np.diff(t))), 1e-4)), 1)
    # copies: a part of the whole would keep all of it
    return HeldPath(
        t[::every].copy(), dense[::every, :3].copy(), np.array(dense[::every, 6:10], order="C")
    )


def moved(path: HeldPath, other: HeldPath) -> Moved:
    """By how much ``other`` is off ``path``, where both are known. Both are of the same drive."""
    known = np.isfinite(path.pos).all(axis=1) & np.isfinite(other.pos).all(axis=1)
    one, two = path.pos[known], other.pos[known]
    north, east = metres_per_radian(one[:, 0], one[:, 2])
    apart = two - one
    level = np.hypot(apart[:, 0] * north, apart[:, 1] * east)
    yaw = quat_to_rpy(other.quat[known])[:, 2] - quat_to_rpy(path.quat[known])[:, 2]
    heading = np.remainder(yaw + np.pi, 2.0 * np.pi) - np.pi
    # the angle between the vehicle's down axes by the chord between them, from both verticals
    chord = (quat_to_matrix(other.quat[known]) - quat_to_matrix(path.quat[known]))[:, 2, :]
    tilt = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(chord, axis=1), 1.0))
    return Moved(path.t[known], level, apart[:, 2], heading, tilt)


def cost_between(paths: Sequence[HeldPath], others: Sequence[HeldPath]) -> Cost:
    """What taking ``others`` for ``paths`` costs on all drives together."""
    parts = [moved(path, other) for path, other in zip(paths, others, strict=True)]
    return Cost(
        level=_extent([p.level for p in parts]),
        height=_extent([p.height for p in parts]),
        heading=_extent([p.heading for p in parts]),
        tilt=_extent([p.tilt for p in parts]),
    )


def costs(
    held_out: Sequence[OpenDrive],
    final: Sequence[Fit],
    values: Values,
    noise: Mapping[str, Collection[str]],
    stated: Mapping[str, float],
    known: Mapping[str, Sequence[HeldPath]],
) -> dict[str, Cost]:
    """The cost of every effect of ``values``, and of every finding on the ``noise``, which has
    the levels that each is about, by name.

    ``final`` the held-out fits of the new model, ``stated`` the noise levels as they were stated,
    ``known`` paths without an effect that were found before: each other takes one fit a drive.
    """
    paths = [held_path(fit) for fit in final]
    model = final[0].model
    out = {}
    for effect in values:
        without = known.get(effect) or paths_without(held_out, model, effect, final)
        out[effect] = cost_between(paths, without)
    for name, its in noise.items():
        levels = {k: float(stated[k]) for k in its if k in stated}
        if levels:
            old = replace(model, factors={**model.factors, **levels})
            fits = fit_held_out(held_out, old, {}, final)
            out[name] = cost_between(paths, [held_path(fit) for fit in fits])
    return out


def paths_without(
    held_out: Sequence[OpenDrive], model: GapModel, effect: str, final: Sequence[Fit]
) -> list[HeldPath]:
    """The held-out paths under the model without one effect."""
    rest = {e: v for e, v in model.values.items() if e != effect}
    fits = fit_held_out(held_out, replace(model, values=rest), {}, final)
    return [held_path(fit) for fit in fits]


def _extent(parts: Sequence[FloatArray]) -> Extent:
    sizes = np.abs(np.concatenate(parts))
    if not len(sizes):
        return Extent(0.0, 0.0)
    return Extent(float(np.sqrt(np.mean(sizes**2))), float(sizes.max()))
