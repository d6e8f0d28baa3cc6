"""What held-out data say of effects that were found, and what each of these costs.

None may be spoken against, and the model with all of them must not predict positions worse than
without. What one costs is how far the smoothed path of a drive moves without it. For which of two
sets drives speak is told by those that were fitted, held-out ones, and the receiver alone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from automap.earth import metres_per_radian
from automap.frames import quat_to_matrix, quat_to_rpy
from automap.fusion.kernel_runs import run_dense
from automap.fusion.layout import CH_POS
from automap.gap import limits
from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit, GapModel, Values
from automap.gap.limits import HUBER
from automap.gap.noise import Fitted
from automap.gap.result import Cost, Extent, HeldPositions, KeptOut
from automap.gap.scoring import (
    Odds,
    fit_held_out,
    gain_over,
    likelier_by_side,
    whitener_of,
)
from automap.records import FloatArray

LEVEL, DOWN = (CH_POS, CH_POS + 1), (CH_POS + 2,)
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
class Confirmed:
    """Effects that held-out data let stand, with their values, and a sentence on each other.

    ``kept_out`` these others; ``positions`` how well positions are predicted; ``without`` effect ->
    held-out paths of the model that lacks it alone, where they were fitted anyhow; ``gains`` nats
    by which held-out data are likelier with each.
    """

    values: dict[str, Mapping[str, float]]
    warnings: tuple[str, ...]
    kept_out: tuple[KeptOut, ...] = ()
    positions: HeldPositions | None = None
    without: Mapping[str, Sequence[HeldPath]] = field(default_factory=dict)
    gains: Mapping[str, float] = field(default_factory=dict)

    def after(self, earlier: Sequence[Confirmed]) -> Confirmed:
        """The same with what was spoken against before."""
        every = (*earlier, self)
        warnings = tuple(text for one in every for text in one.warnings)
        return replace(
            self, warnings=warnings, kept_out=tuple(out for one in every for out in one.kept_out)
        )


def confirmed(
    held_out: Sequence[OpenDrive], model: GapModel, values: Values, must_gain: Collection[str] = ()
) -> Confirmed:
    """Judge effects at ``values`` on held-out drives under ``model``; of those that ``must_gain``
    it is not enough that nothing speaks against them."""
    kept: dict[str, Mapping[str, float]] = dict(values)
    warnings: list[str] = []
    kept_out: list[KeptOut] = []
    paths: dict[str, tuple[frozenset[str], list[HeldPath]]] = {}
    gains: dict[str, float] = {}
    if not held_out:
        return Confirmed(kept, ())
    fits = fit_held_out(held_out, model, kept)
    for effect in list(kept):
        fewer = {e: v for e, v in kept.items() if e != effect}
        without = fit_held_out(held_out, model, fewer, fits)
        gain = gain_over(fits, without, whitener_of(fits[0]))
        if gain < (0.0 if effect in must_gain else -limits.HELD_OUT_SLACK):
            kept, fits = fewer, without
            warnings.append(
                f"{effect} explains the fitted data, but the held-out data are {-gain:.2g} nats "
                "less likely with it; it is not named"
            )
            kept_out.append(KeptOut(effect, False, -gain))
        else:
            gains[effect] = gain
            paths[effect] = frozenset(fewer), [held_path(fit) for fit in without]
        del without
    # under the same noise: a filter that follows its fixes more closely predicts the next one well
    plain = fit_held_out(held_out, model, {}, fits)
    while kept and _worse(fits, plain):
        tries = []
        for effect in kept:
            fewer = {e: v for e, v in kept.items() if e != effect}
            without = fit_held_out(held_out, model, fewer, fits)
            tries.append((float(_missed(without).sum()), effect, fewer, without))
        _, effect, kept, fits = min(tries, key=lambda item: item[0])
        warnings.append(
            f"with {effect} held-out positions are predicted worse than without; it is kept out "
            "of the model"
        )
        kept_out.append(KeptOut(effect, True))
    # those that were fitted beside one that has gone since are of another model
    alone = {e: p for e, (rest, p) in paths.items() if e in kept and rest == set(kept) - {e}}
    positions = _positions(plain, fits)
    return Confirmed(kept, tuple(warnings), tuple(kept_out), positions, alone, gains)


def _positions(before: Sequence[Fit], after: Sequence[Fit]) -> HeldPositions | None:
    sizes = []
    for fits in (before, after):
        channel = np.concatenate([fit.last.forward.store.info[:, 1] for fit in fits])
        # a position has two coordinates level; the loss is half of the square
        counts = [0.5 * np.isin(channel, LEVEL).sum(), np.isin(channel, DOWN).sum()]
        if not all(counts):
            return None
        sizes.append(np.sqrt(2.0 * _missed(fits).sum(axis=1) / counts))
    (level_then, height_then), (level, height) = (s.tolist() for s in sizes)
    return HeldPositions((level_then, level), (height_then, height))


def _missed(fits: Sequence[Fit]) -> FloatArray:
    """By how much positions differ from what is predicted of them, summed over stretches of the
    drives [2, b] level and down, m; what is wild counts as little else (Huber's loss)."""
    out = []
    for fit in fits:
        store = fit.last.forward.store
        t, channel = fit.last.nodes.t[store.info[:, 0]], store.info[:, 1]
        number = max(int(fit.last.nodes.t[-1] / limits.BLOCKS_S[0]), 1)
        edges = np.linspace(0.0, np.nextafter(fit.last.nodes.t[-1], np.inf), number + 1)
        sides = []
        for axes in (LEVEL, DOWN):
            at = np.isin(channel, axes)
            off = np.abs(store.nu[at])
            usual = np.median(off) / 0.6745 if at.any() else 0.0
            most = HUBER * usual
            loss = np.where(off < most, 0.5 * off**2, most * (off - 0.5 * most))
            sides.append(np.histogram(t[at], edges, weights=loss)[0])
        out.append(np.array(sides))
    return np.concatenate(out, axis=1)


def _worse(after: Sequence[Fit], before: Sequence[Fit]) -> bool:
    """Whether positions are predicted worse by more than is allowed, and than their scatter from
    stretch to stretch makes likely, level or down."""
    now, then = _missed(after), _missed(before)
    for a, b in zip(now, then, strict=True):
        more = a - b
        spread = float(np.sqrt(len(more)) * np.std(more))
        total, allowed = float(more.sum()), (1.0 + limits.WORSE_POSITIONS) ** 2 - 1.0
        if total > allowed * float(b.sum()) and total > limits.ONE_IN_A_THOUSAND * spread:
            return True
    return False


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


class Judge:
    """Compares sets on the drives that they were fitted to and on others, ``held_out``: nats by
    which these are likelier with one set than with another, and the sigmas of that."""

    def __init__(self, held_out: Sequence[OpenDrive]) -> None:
        self.held_out = held_out
        self._known: list[tuple[Fitted, list[Fit]]] = []

    def ahead(self, one: Fitted, other: Fitted, of_vehicle: bool, strictly: bool = False) -> Odds:
        """By all drives: where the sets differ by nothing ``of_vehicle`` nothing if the receiver
        alone says the opposite, and ``strictly`` no surer than that is. A body that sways against
        its path turns the gyro with it, and what is made of small turn rates follows that."""
        return _heard(self._fits(one), self._fits(other), of_vehicle, strictly)

    def beyond_drift(self, one: Fitted, other: Fitted, of_vehicle: bool) -> Odds:
        """The same where drift may say what the first set says. On a drive that was fitted it
        follows whatever is slow, each in its own way, so that the two differ there by scatter: for
        the first speaks, too, what held-out drives alone are sure of, where drift begins anew."""
        nats, sigmas = self.ahead(one, other, of_vehicle)
        if nats > 0.0 and self.held_out:
            held = _heard(self._held_out(one), self._held_out(other), of_vehicle, strictly=False)
            sigmas = max(sigmas, held[1])
        return nats, sigmas

    def forget(self) -> None:
        """Forget fits: they are large, and seldom one is asked for again."""
        self._known = []

    def _fits(self, fitted: Fitted) -> list[Fit]:
        return [*fitted.fits, *self._held_out(fitted)]

    def _held_out(self, fitted: Fitted) -> list[Fit]:
        """Held-out drives under a fitted set; the two that were asked for last are kept."""
        known = [one for one in self._known if one[0] is fitted]
        if not known:
            about = self._known[-1][1] if self._known else ()
            fits = fit_held_out(self.held_out, fitted.model, fitted.values(), about)
            known = [(fitted, [_light(fit) for fit in fits])]
        # one that many are compared with stays
        self._known = [*(one for one in self._known if one[0] is not fitted), *known][-2:]
        return known[0][1]


def _heard(one: Sequence[Fit], other: Sequence[Fit], of_vehicle: bool, strictly: bool) -> Odds:
    """By how much drives are likelier under fits than under others, as ``Judge.ahead`` has it."""
    told, received = likelier_by_side(one, other)
    if of_vehicle:
        return told
    if received[0] * told[0] < 0.0:
        return 0.0, 0.0
    return told[0], min(told[1], received[1], key=abs) if strictly else told[1]


def _light(fit: Fit) -> Fit:
    """A fit without what only a linear model asks of it, which is most of its size."""
    store = fit.last.forward.store
    gone = {name: getattr(store, name)[:0].copy() for name in ("h", "gain", "trans")}
    forward = replace(fit.last.forward, store=store._replace(**gone))
    return replace(fit, last=replace(fit.last, forward=forward))
