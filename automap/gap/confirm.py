"""What held-out data say of effects that were found.

None may be spoken against, and the model with all of them must not predict positions worse than
without.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from automap.fusion.layout import CH_POS
from automap.gap import limits
from automap.gap.costs import HeldPath, held_path
from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit, GapModel, Values
from automap.gap.limits import HUBER
from automap.gap.result import HeldPositions, KeptOut
from automap.gap.scoring import fit_held_out, gain_over, whitener_of
from automap.records import FloatArray

LEVEL, DOWN = (CH_POS, CH_POS + 1), (CH_POS + 2,)


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
