"""Positions that lie aside of where the velocities beside them lead, by a pattern: seen from the
vehicle throughout, from an instant on, or at every second fix; or that become older.

Position is its own witness for minutes only: what lies aside for longer counts as wander. But an
offset that turns with the vehicle moves in every bend, which velocities do not tell; where it
begins, positions jump, as where fixes become older by the way of that time; and what comes and goes
from fix to fix no wander does. Each is an error that is added to the fixes, and its size
generalised least squares on the innovations of the constant-velocity filter (De Jong, J. American
Statistical Association 86, 1991).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion import limits
from automap.fusion.doubts.alternation import alternation
from automap.fusion.doubts.limits import (
    OFFSET_INSTANTS,
    SLOPE_ROUNDS,
    STEP_WINDOW_S,
    UNHELD_PROBABILITY,
)
from automap.fusion.doubts.reason import Reason, State
from automap.fusion.fix_axes import Epochs, whitened_epochs
from automap.fusion.options import FusionOptions
from automap.gates import gate, sd_by_median
from automap.interpolation import Poses
from automap.records import BoolArray, FloatArray, Trajectory
from automap.robust import cauchy_weight

_PLANE = (0, 1)
_ROWS = 1 << 16
"""Of a design that are weighed at once: a few megabytes."""


@dataclass(frozen=True)
class Offset:
    """Metres ``forward`` and to the ``right`` of the vehicle, from ``at_s`` s of the drive on, and
    the squared distance from none in sigmas; ``older_s`` s where it is an age instead, of positions
    and velocities."""

    forward: float
    right: float
    square: float
    at_s: float = 0.0
    older_s: float = 0.0

    @property
    def size(self) -> float:
        """Its length, m."""
        return float(np.hypot(self.forward, self.right))

    @property
    def terms(self) -> int:
        """By how many numbers it is told."""
        return 1 if self.older_s else 2


def offset_doubts(
    at: Epochs,
    motion: Trajectory | Poses,
    options: FusionOptions,
    levels: Mapping[str, float],
    sd_m: float,
    jumps: Sequence[float] = (),
    bridged: bool = False,
) -> Iterator[Reason]:
    """Reasons that the epochs ``at`` [k] give by themselves; ``motion`` [k] the vehicle's there,
    ``levels`` the sizes of their errors, ``sd_m`` what the path is good to, m an axis. A shift at
    ``jumps``, s of the drive, is told already. ``bridged`` as in ``offsets``.

    An offset that is smaller than that is no doubt, but adds to it.
    """

    def reason(code: str, size: float, text: str) -> Reason:
        state: State = "doubtful" if size > sd_m else "good"
        return Reason(code, text, error_m=size, state=state)

    apart = 2.0 * alternation(at, options, levels)
    # no two antennas are nearer: what is, a receiver that moves its fixes on between some makes
    if apart > limits.STATED_ARM_SD_M:
        # two receivers tell little of how far their mean is off; and beside what goes to and fro,
        # which no white noise is, a drive shows too little of what lasts
        yield Reason(
            "fixes_alternate",
            f"every second position lies {apart:.1f} m aside of those between: the log holds two "
            "receivers or antennas in turn; keep those of one",
            error_m=apart,
        )
        return
    change, aside = offsets(at, motion, options, levels, bridged)
    if change is not None and change.older_s:
        speed = np.hypot(motion.vel_ned[:, 0], motion.vel_ned[:, 1])
        metres = abs(change.older_s) * float(np.median(speed[speed > limits.DRIVING_SPEED]))
        yield Reason(
            "age_changes",
            f"from {change.at_s:.0f} s of the drive on positions and velocities are "
            f"{abs(change.older_s):.2f} s {'older' if change.older_s > 0.0 else 'younger'} than "
            "before: another receiver, or another setting of it; cut the drive there",
            late_s=abs(change.older_s),
            state="doubtful" if metres > sd_m else "good",
        )
    elif change is not None and any(abs(change.at_s - s) < STEP_WINDOW_S for s in jumps):
        return
    elif change is not None:
        yield reason(
            "positions_shift",
            change.size,
            f"from {change.at_s:.0f} s of the drive on positions lie {_words(change)} of where the "
            "velocities lead from those before: another antenna or receiver, or reflections; cut "
            "the drive there",
        )
    elif aside is not None:
        yield reason(
            "positions_beside",
            aside.size,
            f"positions lie {_words(aside)} of the vehicle that the velocities show in bends: they "
            "were put on another lane, or are another antenna's than the velocities",
        )


def _words(offset: Offset) -> str:
    along = "ahead" if offset.forward > 0.0 else "behind"
    across = "to the right" if offset.right > 0.0 else "to the left"
    parts = [(abs(offset.forward), along), (abs(offset.right), across)]
    told = [part for part in parts if part[0] > 0.5 * offset.size]
    return " and ".join(f"{size:.1f} m {side}" for size, side in told)


Whiten = Callable[[FloatArray], FloatArray]
"""Errors [k, 2, 2, c] of positions and velocities, north and east, as innovations of the two axes
one after the other [m, 1 + c], those of the fixes first."""


def offsets(
    at: Epochs,
    motion: Trajectory | Poses,
    options: FusionOptions,
    levels: Mapping[str, float],
    bridged: bool = False,
) -> tuple[Offset | None, Offset | None]:
    """The likeliest offset that begins within the drive, and one of the whole drive, of the epochs
    ``at`` [k] beside the vehicle's ``motion`` [k]; None where chance makes it. ``bridged``: an IMU
    tells how it went on where fixes are left out."""
    velocity, course = motion.vel_ned[:, :2], motion.rpy[:, 2]
    driving = np.hypot(velocity[:, 0], velocity[:, 1]) > limits.DRIVING_SPEED
    placed = np.asarray(at.used[:2, :, 0].all(axis=0))
    told = np.asarray(at.used[:2, :, 1].all(axis=0))
    if np.count_nonzero(placed & driving) < limits.LEAST_JUDGED:
        return None, None

    def whiten(at: Epochs, errors: FloatArray) -> FloatArray:
        parts = [np.ascontiguousarray(errors[:, :, axis]) for axis in _PLANE]
        return np.concatenate(
            [whitened_epochs(at, axis, options, levels, parts[axis]) for axis in _PLANE]
        )

    forward = np.column_stack([np.cos(course), np.sin(course)])
    sides = np.stack([forward, np.column_stack([-forward[:, 1], forward[:, 0]])], axis=2)

    own = receivers_own(at.t, velocity)
    aside_or_older = np.zeros((len(at.t), 2, 2, 3))
    aside_or_older[:, 0, :, :2] = sides
    # what was some seconds before, of positions and velocities
    aside_or_older[..., 2] = own[..., 0] - own[..., 2]

    known = np.concatenate([own, aside_or_older[..., :2]], axis=3)
    whole = whiten(at, known)

    def from_instant(at: Epochs, s: float, beside: FloatArray) -> tuple[Offset, Offset]:
        beginning = aside_or_older * (at.t >= s)[:, None, None, None]
        y, aside, older = np.split(whiten(at, beginning), [1, 3], axis=1)
        (forward_m, right_m), far = _fitted(y[:, 0], aside, beside)
        (older_s,), long = _fitted(y[:, 0], older, beside)
        at_s = s - at.t[0]
        return Offset(forward_m, right_m, far, at_s), Offset(0.0, 0.0, long, at_s, older_s)

    # one of as many as there are fixes; the likelier, by the number of its terms (Akaike)
    found = [
        offset
        for s in _instants(at, placed)
        for offset in from_instant(at, s, whole[:, 1:])
        if offset.square > gate(limits.DOUBT_PROBABILITY / len(at.t), offset.terms)
    ]
    change = max(found, key=lambda offset: offset.square - 2.0 * offset.terms, default=None)
    if change is not None and bridged:
        # a receiver may err for some seconds and be right again: the rest has to show it too
        s = change.at_s + at.t[0]
        rest_of = _without(at, s)
        far, long = from_instant(rest_of, s, whiten(rest_of, known)[:, 1:])
        rest = long if change.older_s else far
        if rest.square < gate(UNHELD_PROBABILITY, rest.terms):
            change = None
    if np.count_nonzero(placed & told & driving) < limits.LEAST_JUDGED:
        return change, None
    y, of_receiver, beside = np.split(whole, [1, 6], axis=1)
    (forward_m, right_m), square = _fitted(y[:, 0], beside, of_receiver)
    if square < gate(limits.DOUBT_PROBABILITY, 2):
        return change, None
    return change, Offset(forward_m, right_m, square)


def _without(at: Epochs, instant: float) -> Epochs:
    """The epochs but those of some seconds about an instant."""
    near = np.abs(at.t - instant) < 0.5 * STEP_WINDOW_S
    return replace(at, used=at.used & ~near[:, None])


def receivers_own(t: FloatArray, velocity: FloatArray) -> FloatArray:
    """Errors [k, 2, 2, 5] that a sound receiver's filter makes of ``velocity`` [k, 2] m/s at ``t``
    [k] s: positions that lag, to the second order, velocities that do, their scale and turn."""
    change, none = np.gradient(velocity, t, axis=0), np.zeros_like(velocity)
    across = np.column_stack([-velocity[:, 1], velocity[:, 0]])
    errors = (-velocity, none), (change, none), (none, change), (none, velocity), (none, across)
    return np.stack([np.stack(pair, axis=1) for pair in errors], axis=3)


def _instants(at: Epochs, placed: BoolArray) -> FloatArray:
    """Instants from which an offset is tried: spread over the drive, and where positions leave most
    the way that velocities lead; of the epochs ``placed`` [k] that have one."""
    n, rows = OFFSET_INSTANTS, np.flatnonzero(placed)
    t, z, v = at.t[rows], at.z[:2, rows, 0], at.z[:2, rows, 1]
    step = np.diff(t)
    half = max(round(STEP_WINDOW_S / float(np.median(step))), 1)
    if len(rows) <= 2 * half:
        return np.zeros(0)
    way = np.cumsum(0.5 * (v[:, 1:] + v[:, :-1]) * step, axis=1)
    apart = z - np.pad(way, ((0, 0), (1, 0)))
    total = np.pad(np.cumsum(apart, axis=1), ((0, 0), (1, 0)))
    k = np.arange(half, len(rows) - half + 1)
    jump = np.hypot(*(total[:, k + half] - 2.0 * total[:, k] + total[:, k - half]))
    found = list(np.linspace(t[half], t[len(rows) - half - 1], n))
    for i in np.argsort(-jump):
        when = float(t[min(k[i], len(rows) - 1)])
        if len(found) == 2 * n:
            break
        if all(abs(when - other) > STEP_WINDOW_S for other in found[n:]):
            found.append(when)
    return np.array(found)


def _fitted(y: FloatArray, *parts: FloatArray) -> tuple[tuple[float, ...], float]:
    """Coefficients of the columns of the first of ``parts`` [m, p], beside those of the others, in
    ``y`` [m], and their squared distance from none in sigmas; robustly, as fixes have tails."""
    p = parts[0].shape[1]
    if not (np.isfinite(y).all() and all(np.isfinite(part).all() for part in parts)):
        return (0.0,) * p, 0.0
    # a long drive's columns are large: they are joined some rows at a time
    some = [slice(a, a + _ROWS) for a in range(0, len(y), _ROWS)]
    scale = np.concatenate([np.sqrt(np.einsum("ij,ij->j", part, part)) for part in parts]) + 1e-9
    weight, value = np.ones(len(y)), np.zeros(len(scale))
    rest: FloatArray = y
    normal: FloatArray = np.eye(len(scale))
    for _ in range(SLOPE_ROUNDS):
        squares, along = np.zeros((len(scale), len(scale))), np.zeros(len(scale))
        for rows in some:
            design = np.hstack([part[rows] for part in parts])
            weighed = design * weight[rows, None]
            squares += weighed.T @ design
            along += weighed.T @ y[rows]
        normal = np.asarray(np.linalg.pinv(squares / np.outer(scale, scale)))
        value = normal @ (along / scale) / scale
        rest = np.concatenate([y[r] - np.hstack([part[r] for part in parts]) @ value for r in some])
        weight = cauchy_weight((rest / max(sd_by_median(rest), 1e-9)) ** 2)
    # a filter that is less sure than it might be proves nothing
    spread = max(float((weight * rest**2).sum() / weight.sum()), 1.0)
    cov = spread * normal[:p, :p] / np.outer(scale[:p], scale[:p])
    value = value[:p]
    return tuple(float(v) for v in value), float(value @ np.linalg.pinv(cov) @ value)
